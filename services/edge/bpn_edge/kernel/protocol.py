"""What every kernel can do."""

from typing import Protocol

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.golden import Integers, Observation


class Kernel(Protocol):
    """Computes the integer outputs o of one policy; P = lambda * o (paper, section IV-B).

    One thread at a time may load; `run` uses the weights of the last `load` that returned.
    """

    @property
    def name(self) -> str:
        """What `bpn_edge.kernel.load` calls this kernel."""
        ...

    def load(self, blob: WeightBlob) -> None:
        """Replaces the weights; any geometry is taken."""
        ...

    def run(self, observation: Observation) -> Integers:
        """One inference.

        Args:
            observation: uint8[C, 84, 84]; a view that is not C-contiguous is copied first.

        Returns:
            o_5, int32[|A|], an array of its own.

        Raises:
            RuntimeError: nothing was loaded yet.
            ValueError: the observation has another dtype or shape.
        """
        ...


def not_loaded(name: str) -> RuntimeError:
    """The error of a kernel that is run without weights."""
    return RuntimeError(f"kernel {name!r} has no weights: call load(blob) before run(observation)")
