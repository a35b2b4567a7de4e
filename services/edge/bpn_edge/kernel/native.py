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

    It runs every network that there can be: the paper's shape by code that is written for it, others by code for
    any chain of layers. Which of them is chosen when weights are loaded.

    Args:
        path: an instruction-set path of `available_paths`; by default the best.
        any_shape: run the paper's shape too as any other, for tests and measurements.

    Raises:
        ValueError: this machine cannot run that path.
    """

    name = "native"

    def __init__(self, path: str | None = None, *, any_shape: bool = False) -> None:
        paths = available_paths()
        if path is not None and path not in paths:
            raise ValueError(f"path = {path!r} does not run here; one of: {', '.join(paths)}")
        self.path = path or paths[0]
        self._any_shape = any_shape
        self._loaded: tuple[_native.Network, NetworkSpec] | None = None

    def load(self, weights: Weights) -> None:
        """See `Kernel.load`; runs that have begun end with the weights they began with."""
        blob = binarized(self.name, weights)
        layers = [
            (layer.in_size, layer.in_channels, layer.kernel, layer.stride, layer.out_channels)
            for layer in blob.spec.layers
        ]
        network = _native.Network(self.path, self._any_shape, layers, blob.weights, blob.thresholds)
        self._loaded = network, blob.spec

    def read_back(self) -> Parameters:
        """See `Kernel.read_back`; unpacked from the memory that the forward pass reads."""
        network, spec = self._held()
        try:
            weights, thresholds = network.read_back()
        except RuntimeError as error:
            raise BlobError(f"the {self.name} kernel: {error}") from error
        names = [layer.name for layer in spec.layers]
        return {f"weights of {name}": w for name, w in zip(names, weights, strict=True)} | {
            f"thresholds of {name}": t for name, t in zip(names[:-1], thresholds, strict=True)
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
        return self._held()[0]

    def run(self, observation: Observation) -> Integers:
        """See `Kernel.run`."""
        if self._loaded is None:  # without a call: it is a tenth of an inference
            raise not_loaded(self.name)
        return self._loaded[0].run(observation)

    def trace(self, observation: Observation) -> tuple[tuple[Observation, ...], Integers]:
        """One inference with its inner activations, for tests and diagnosis.

        Returns:
            The activations of all layers but the last as uint8 (1 is +1, 0 is -1), each flattened from
            [out_size, out_size, out_channels]; and the outputs, int32[|A|].

        Raises:
            RuntimeError, ValueError: as `run`.
        """
        return self.network.trace(observation)

    def _held(self) -> tuple[_native.Network, NetworkSpec]:
        if self._loaded is None:
            raise not_loaded(self.name)
        return self._loaded
