"""Kernels: what turns one observation into the outputs of a policy's network.

Each is an entry point of the group `bpn.kernels`, the project's own too; docs/own-kernel.md.
"""

from collections.abc import Callable
from importlib.util import find_spec

from bpn_edge.fpga import connected, verilated
from bpn_edge.kernel.protocol import Kernel
from bpn_shared import plugins

__all__ = ["Kernel", "banks", "load", "usable_kernels"]


def load(name: str) -> Kernel:
    """A kernel without weights yet.

    Raises:
        PluginError: none of that name is installed, the message lists those that are; or it cannot be made.
        ConfigError: what it needs is not installed.
    """
    kernel: Kernel = plugins.find(plugins.KERNELS, name).call()
    return kernel


def usable_kernels() -> tuple[str, ...]:
    """Names of those that are installed here with what they need; imports none of them."""
    installed = plugins.names(plugins.KERNELS)
    return tuple(name for name in installed if name not in _NEEDS or _NEEDS[name]())


def banks(name: str) -> tuple[Kernel, Kernel]:
    """Two kernels of that name without weights: the banks of a device that has two itself, else two of them.

    Raises:
        PluginError, ConfigError: as `load`.
    """
    kernel = load(name)
    other_bank: Callable[[], Kernel] | None = getattr(kernel, "other_bank", None)
    return kernel, load(name) if other_bank is None else other_bank()


_NEEDS: dict[str, Callable[[], bool]] = {
    "onnx": lambda: find_spec("onnxruntime") is not None,
    "rtl": verilated.is_possible,
    "fpga": connected.is_there,
}
"""Whether what one of the project's own kernels needs is here."""
