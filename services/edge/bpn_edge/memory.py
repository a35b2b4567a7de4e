"""Weight memory with two banks, like the FPGA's BRAM: one runs, the other takes the next version."""

import logging
import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel import Kernel, banks
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.outputs import Outputs
from bpn_shared.bnn.weights import NO_RANK, Rank, Weights, rank_of
from bpn_shared.counters import Counters

log = logging.getLogger(__name__)

_FLOAT_TOLERANCE = 1e-3
"""Of P's magnitude: far above what another order of summation changes, far below what a wrong model does."""
_TRIES = 3
"""A policy that a bank has failed to take so often in a row will not be taken the next time either."""


@dataclass(frozen=True, slots=True)
class _Failure:
    rank: Rank
    times: int
    reason: str


class WeightMemory:
    """Two kernels: the active bank runs, `offer` fills the other one, `activate` swaps them.

    `offer` may be called from a network thread at any time, it never touches the active bank; `activate` must
    not be called while `run` may be, so that a swap falls between two episodes.
    """

    def __init__(self, kernel: str, counters: Counters) -> None:
        self._active, self._idle = banks(kernel)
        self._counters = counters
        self._changed = threading.Condition()
        self._offered: Weights | None = None
        self._failure: _Failure | None = None
        self._checksum = self._offered_checksum = 0
        self.weights: Weights | None = None
        """What the active bank holds."""

    def offer(self, weights: Weights) -> bool:
        """Loads a policy into the idle bank and verifies the bank; what was there before is gone.

        Returns:
            False if the bank failed the verification; it is not used.
        """
        with self._changed:
            self._offered = None
            try:
                self._idle.load(weights)
                verify(self._idle, weights)
            except Exception as error:  # a device has errors of its own
                self._refuse(weights, error)
                return False
            self._offered, self._failure = weights, None
            self._offered_checksum = self._idle.checksum()
            self._changed.notify_all()
            return True

    def _refuse(self, weights: Weights, error: Exception) -> None:
        rank, before = rank_of(weights), self._failure
        times = before.times + 1 if before is not None and before.rank == rank else 1
        self._failure = _Failure(rank, times, str(error) or type(error).__name__)
        self._counters.refuse(
            "weights_failed_verification",
            f"version {weights.version} is not used: {self._failure.reason}",
        )

    def why_never(self, version: int) -> str | None:
        """Why there is no use in waiting for that version: its bank failed again and again; None: there is."""
        failure = self._failure
        if failure is None or failure.rank[1] != version or failure.times < _TRIES:
            return None
        return f"weights version {version} failed the verification {_TRIES} times: {failure.reason}"

    def activate(self, version: int, timeout_s: float, *, attempt: int = 0) -> bool:
        """Makes `version` of at least `attempt` the running one, by swapping banks if need be.

        A bit of the bank that flipped since it was verified is noticed here, by the bank's checksum; the policy
        then counts as not held.

        Returns:
            False if it has not been offered within the timeout.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._holds(version, attempt), timeout_s)
            offered = self._offered
            if offered is not None and _fits(offered, version, attempt):
                self._active, self._idle = self._idle, self._active
                self.weights, self._offered = offered, None
                self._checksum = self._offered_checksum
                log.info("runs weights version %d of attempt %d", offered.version, offered.attempt)
            return _fits(self.weights, version, attempt) and self.is_intact()

    def is_intact(self) -> bool:
        """Whether the active bank still holds what was verified; if not, its policy is held no more."""
        with self._changed:
            if self.weights is None or self._active.checksum() == self._checksum:
                return self.weights is not None
            version, self.weights = self.weights.version, None
            self._counters.refuse(
                "weights_damaged",
                f"the bank's memory has changed while version {version} ran: it has to be loaded again",
            )
            return False

    def wait_newer(self, version: int | None, timeout_s: float) -> bool:
        """Whether the newest version becomes another one than `version` within the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: self.newest != version, timeout_s)

    @property
    def newest(self) -> int | None:
        """The newest version in either bank; None before the first."""
        rank = self.rank
        return None if rank == NO_RANK else rank[1]

    @property
    def rank(self) -> Rank:
        """Attempt and version of the newest policy in either bank; `NO_RANK` where there is none."""
        with self._changed:
            newest = self._offered or self.weights
            return NO_RANK if newest is None else rank_of(newest)

    def _holds(self, version: int, attempt: int) -> bool:
        return any(_fits(weights, version, attempt) for weights in (self.weights, self._offered))

    def run(self, observation: npt.NDArray[np.uint8]) -> Outputs:
        """Outputs [|A|] of an observation uint8[C, rows, columns] under the active bank."""
        return self._active.run(observation)


def _fits(weights: Weights | None, version: int, attempt: int) -> bool:
    return weights is not None and weights.version == version and weights.attempt >= attempt


def verify(kernel: Kernel, weights: Weights) -> None:
    """Compares what is in the kernel's memory with the policy, and tries the kernel's arithmetic on a probe.

    Raises:
        BlobError: the kernel holds, or computes, something else.
    """
    compare(kernel, weights)
    probe = weights.spec.probe()
    found = kernel.run(probe)
    if isinstance(weights, WeightBlob):
        if not np.array_equal(found, golden.forward(weights, probe)[-1]):
            raise BlobError(f"the {kernel.name} kernel computes it wrongly (try kernel golden)")
        return
    expected = weights.probe_outputs
    tolerance = _FLOAT_TOLERANCE * float(np.abs(expected).max())
    if not np.allclose(found, expected, rtol=0, atol=tolerance):
        # No values: what a policy computes may be what it was made to tell.
        raise BlobError(
            f"the {kernel.name} kernel computes another P of the probe than the learner"
        )


def compare(kernel: Kernel, weights: Weights) -> None:
    """Compares every parameter in the kernel's memory with the policy's.

    Raises:
        BlobError: one differs.
    """
    found = kernel.read_back()
    for name, expected in weights.parameters().items():
        held = found.get(name)
        if held is None or held.shape != expected.shape:
            raise BlobError(f"the {kernel.name} kernel's memory holds other {name}")
        if not np.array_equal(held, expected):
            wrong = np.count_nonzero(held != expected)
            raise BlobError(
                f"{wrong} of {expected.size} {name} differ in the {kernel.name} kernel's memory"
            )
