"""The reference arithmetic as a kernel: slow (1-3 ms), needs nothing but numpy."""

from bpn_edge.kernel.protocol import binarized, checksum_of, not_loaded
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import Parameters, WeightBlob
from bpn_shared.bnn.golden import Integers, Observation
from bpn_shared.bnn.weights import Weights


class GoldenKernel:
    """A `Kernel` over `bpn_shared.bnn.golden`."""

    name = "golden"

    def __init__(self) -> None:
        self._blob: WeightBlob | None = None

    def load(self, weights: Weights) -> None:
        """See `Kernel.load`."""
        self._blob = binarized(self.name, weights)

    def read_back(self) -> Parameters:
        """See `Kernel.read_back`."""
        if self._blob is None:
            raise not_loaded(self.name)
        return self._blob.parameters()

    def checksum(self) -> int:
        """See `Kernel.checksum`."""
        return checksum_of(self.read_back())

    def run(self, observation: Observation) -> Integers:
        """See `Kernel.run`."""
        if self._blob is None:
            raise not_loaded(self.name)
        return golden.forward(self._blob, observation)[-1]
