"""What every kernel can do."""

import zlib
from typing import Protocol

from bpn_shared.bnn.blob import Parameters, WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.golden import Observation
from bpn_shared.bnn.outputs import Outputs
from bpn_shared.bnn.weights import Weights


class Kernel(Protocol):
    """Computes the outputs of one policy; P = scale * outputs (paper, section IV-B).

    One thread at a time may load; `run` uses the weights of the last `load` that returned.
    """

    @property
    def name(self) -> str:
        """What `bpn_edge.kernel.load` calls this kernel."""
        ...

    def load(self, weights: Weights) -> None:
        """Replaces the weights; any geometry is taken.

        Raises:
            BlobError: the kernel does not run policies of that kind, or cannot run this one.
        """
        ...

    def read_back(self) -> Parameters:
        """Every parameter as it is in the kernel's memory now, named as the policy's `parameters()`.

        Raises:
            RuntimeError: nothing was loaded yet.
            BlobError: the memory holds what no policy is stored as.
        """
        ...

    def checksum(self) -> int:
        """A number that changes with any bit of that memory: quick, for between two episodes.

        Raises:
            RuntimeError: nothing was loaded yet.
        """
        ...

    def run(self, observation: Observation) -> Outputs:
        """One inference.

        Args:
            observation: uint8[C, rows, columns]; a view that is not C-contiguous is copied first.

        Returns:
            [|A|], an array of its own: o_5 as int32 of a binarized policy, P as float32 of a float one.

        Raises:
            RuntimeError: nothing was loaded yet.
            ValueError: the observation has another dtype or shape.
            OutputError: an output is no number.
        """
        ...


class OutputError(BlobError):
    """The network's outputs are not all finite: no action can be chosen by them."""


def binarized(name: str, weights: Weights) -> WeightBlob:
    """The policy for a kernel that runs binarized ones.

    Raises:
        BlobError: it is another.
    """
    if not isinstance(weights, WeightBlob):
        raise BlobError(f"the {name} kernel runs binarized policies, this one is float")
    return weights


def checksum_of(parameters: Parameters) -> int:
    """`Kernel.checksum` of a kernel whose memory is these arrays."""
    sum_ = 0
    for values in parameters.values():
        sum_ = zlib.crc32(values.tobytes(), sum_)
    return sum_


def not_loaded(name: str) -> RuntimeError:
    """The error of a kernel that is run without weights."""
    return RuntimeError(
        f"kernel {name!r} has no weights: call load(weights) before run(observation)"
    )
