"""Kernels: what turns one observation into the integer outputs o of a policy."""

from typing import Literal

from bpn_edge.kernel.golden import GoldenKernel
from bpn_edge.kernel.native import NativeKernel
from bpn_edge.kernel.protocol import Kernel

__all__ = ["Kernel", "load"]

KernelName = Literal["native", "golden"]
_KERNELS: dict[str, type[NativeKernel] | type[GoldenKernel]] = {
    "native": NativeKernel,
    "golden": GoldenKernel,
}


def load(name: KernelName) -> Kernel:
    """A kernel without weights yet.

    Raises:
        ValueError: there is no kernel of that name; the message lists those there are.
    """
    if name not in _KERNELS:
        raise ValueError(f"kernel = {name!r} is unknown; one of: {', '.join(_KERNELS)}")
    return _KERNELS[name]()
