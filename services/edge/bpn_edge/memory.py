"""Weight memory with two banks, like the FPGA's BRAM: one runs, the other takes the next version."""

import logging
import threading

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel import load
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.spec import NetworkSpec
from bpn_shared.config import Kernel as KernelName
from bpn_shared.service import Counters

log = logging.getLogger(__name__)


class WeightMemory:
    """Two kernels: the active bank runs, `offer` fills the other one, `activate` swaps them.

    `offer` may be called from a network thread at any time; `activate` and `run` belong to the thread that
    drives the robot, so a swap falls between two frames and never within one.
    """

    def __init__(self, kernel: KernelName, spec: NetworkSpec, counters: Counters) -> None:
        self._active, self._idle = load(kernel), load(kernel)
        self._counters = counters
        self._changed = threading.Condition()
        self._offered: WeightBlob | None = None
        self.blob: WeightBlob | None = None
        """What the active bank holds."""
        # any fixed picture serves: a wrong bit anywhere upstream of o would have to cancel out
        self._probe = np.random.default_rng(0).integers(
            0, 256, spec.observation_shape, dtype=np.uint8
        )

    def offer(self, blob: WeightBlob) -> bool:
        """Loads a blob into the idle bank and verifies the bank against the golden model.

        Returns:
            False if the bank failed the verification; it is not used.
        """
        with self._changed:
            self._idle.load(blob)
            expected = golden.forward(blob, self._probe)[-1]
            if not np.array_equal(self._idle.run(self._probe), expected):
                self._offered = None
                self._counters.refuse(
                    "weights_failed_verification",
                    f"the {self._idle.name} kernel computes version {blob.version} wrongly; "
                    "the bank is not used (try --kernel golden)",
                )
                return False
            self._offered = blob
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
                self.blob, self._offered = offered, None
                log.info("runs weights version %d of attempt %d", offered.version, offered.attempt)
            return self.blob is not None and self.blob.version == version

    def _holds(self, version: int) -> bool:
        return any(
            blob is not None and blob.version == version for blob in (self.blob, self._offered)
        )

    def run(self, observation: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
        """o, int32[|A|], of an observation uint8[C, 84, 84] under the active bank."""
        return self._active.run(observation)
