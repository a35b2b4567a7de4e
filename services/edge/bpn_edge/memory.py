"""Weight memory with two banks, like the FPGA's BRAM: one runs, the other takes the next version."""

import logging
import threading

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel import Kernel, load
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import BlobError, WeightBlob
from bpn_shared.config import Kernel as KernelName
from bpn_shared.outputs import Outputs
from bpn_shared.service import Counters
from bpn_shared.weights import Weights

log = logging.getLogger(__name__)

_FLOAT_TOLERANCE = 1e-3
"""Of P's magnitude: far above what another order of summation changes, far below what a wrong model does."""


class WeightMemory:
    """Two kernels: the active bank runs, `offer` fills the other one, `activate` swaps them.

    `offer` may be called from a network thread at any time; `activate` and `run` belong to the thread that
    drives the robot, so a swap falls between two frames and never within one.
    """

    def __init__(self, kernel: KernelName, counters: Counters) -> None:
        self._active, self._idle = load(kernel), load(kernel)
        self._counters = counters
        self._changed = threading.Condition()
        self._offered: Weights | None = None
        self.weights: Weights | None = None
        """What the active bank holds."""

    def offer(self, weights: Weights) -> bool:
        """Loads a policy into the idle bank and verifies the bank.

        Returns:
            False if the bank failed the verification; it is not used.
        """
        with self._changed:
            try:
                self._idle.load(weights)
                verify(self._idle, weights)
            except BlobError as error:
                self._offered = None
                self._counters.refuse(
                    "weights_failed_verification", f"version {weights.version} is not used: {error}"
                )
                return False
            self._offered = weights
            self._changed.notify_all()
            return True

    def activate(self, version: int, timeout_s: float) -> bool:
        """Makes `version` the running one, by swapping banks if need be.

        Returns:
            False if that version has not been offered within the timeout.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._holds(version), timeout_s)
            offered = self._offered
            if offered is not None and offered.version == version:
                self._active, self._idle = self._idle, self._active
                self.weights, self._offered = offered, None
                log.info("runs weights version %d of attempt %d", offered.version, offered.attempt)
            return self.weights is not None and self.weights.version == version

    def wait_newer(self, version: int | None, timeout_s: float) -> bool:
        """Whether the newest version becomes another one than `version` within the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: self.newest != version, timeout_s)

    @property
    def newest(self) -> int | None:
        """The newest version in either bank; None before the first."""
        with self._changed:
            newest = self._offered or self.weights
            return None if newest is None else newest.version

    def _holds(self, version: int) -> bool:
        return any(
            weights is not None and weights.version == version
            for weights in (self.weights, self._offered)
        )

    def run(self, observation: npt.NDArray[np.uint8]) -> Outputs:
        """Outputs [|A|] of an observation uint8[C, 84, 84] under the active bank."""
        return self._active.run(observation)


def verify(kernel: Kernel, weights: Weights) -> None:
    """Runs a probe: a binarized policy as the golden model does, a float one to P as the learner has it.

    Raises:
        BlobError: the kernel, which holds the policy, computes something else.
    """
    probe = weights.spec.probe()
    found = kernel.run(probe)
    if isinstance(weights, WeightBlob):
        if not np.array_equal(found, golden.forward(weights, probe)[-1]):
            raise BlobError(f"the {kernel.name} kernel computes it wrongly (try --kernel golden)")
        return
    expected = weights.probe_outputs
    tolerance = _FLOAT_TOLERANCE * float(np.abs(expected).max())
    if not np.allclose(found, expected, rtol=0, atol=tolerance):
        # No values: what a policy computes may be what it was made to tell.
        raise BlobError(
            f"the {kernel.name} kernel computes another P of the probe than the learner"
        )
