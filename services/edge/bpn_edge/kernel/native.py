"""The C++ kernel: bit-parallel XNOR/popcount, bit-exact with `bpn_shared.bnn.golden`."""

from bpn_edge.kernel import _native
from bpn_edge.kernel.protocol import binarized, not_loaded
from bpn_shared.bnn.blob import Parameters
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.golden import Integers, Observation
from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.network import NetworkSpec


def available_paths() -> tuple[str, ...]:
    """The instruction-set paths that this machine can run, best first; "portable" is always one."""
    return tuple(_native.available_paths())


class NativeKernel:
    """A `Kernel` in C++. `run` releases the GIL, and several threads may run it at once.

    Args:
        path: an instruction-set path of `available_paths`; by default the best.

    Raises:
        ValueError: this machine cannot run that path.
    """

    name = "native"

    def __init__(self, path: str | None = None) -> None:
        paths = available_paths()
        if path is not None and path not in paths:
            raise ValueError(f"path = {path!r} does not run here; one of: {', '.join(paths)}")
        self.path = path or paths[0]
        self._network: _native.Network | None = None
        self._spec: NetworkSpec | None = None

    def load(self, weights: Weights) -> None:
        """See `Kernel.load`; runs that have begun end with the weights they began with."""
        blob = binarized(self.name, weights)
        self._network = _native.Network(
            self.path, blob.spec.channels, blob.weights, blob.thresholds
        )
        self._spec = blob.spec

    def read_back(self) -> Parameters:
        """See `Kernel.read_back`; unpacked from the memory that the forward pass reads."""
        network = self.network
        try:
            weights, thresholds = network.read_back()
        except RuntimeError as error:
            raise BlobError(f"the {self.name} kernel: {error}") from error
        assert self._spec is not None
        names = [layer.name for layer in self._spec.layers]
        return {f"weights of {name}": w for name, w in zip(names, weights, strict=True)} | {
            f"thresholds of {name}": t for name, t in zip(names, thresholds, strict=False)
        }

    def checksum(self) -> int:
        """See `Kernel.checksum`."""
        return self.network.checksum()

    @property
    def network(self) -> _native.Network:
        """What runs.

        Raises:
            RuntimeError: nothing was loaded yet.
        """
        if self._network is None:
            raise not_loaded(self.name)
        return self._network

    def run(self, observation: Observation) -> Integers:
        """See `Kernel.run`."""
        return self.network.run(observation)

    def trace(self, observation: Observation) -> tuple[tuple[Observation, ...], Integers]:
        """One inference with its inner activations, for tests and diagnosis.

        Returns:
            The activations of layers 1-4 as uint8 (1 is +1, 0 is -1), flattened from
            [20,20,8], [9,9,16], [7,7,16] and [N]; and o_5, int32[|A|].

        Raises:
            RuntimeError, ValueError: as `run`.
        """
        *activations, outputs = self.network.trace(observation)
        return tuple(activations), outputs
