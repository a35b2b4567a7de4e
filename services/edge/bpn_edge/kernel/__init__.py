"""Kernels: what turns one observation into the outputs of a policy's network."""

from pkgutil import resolve_name

from bpn_edge.kernel.protocol import Kernel
from bpn_shared.spec.config import ConfigError

__all__ = ["Kernel", "load"]

_KERNELS = {  # by name: a kernel's own dependencies are needed only where it runs
    "native": "bpn_edge.kernel.native:NativeKernel",
    "golden": "bpn_edge.kernel.golden:GoldenKernel",
    "onnx": "bpn_edge.kernel.onnx:OnnxKernel",
}


def load(name: str) -> Kernel:
    """A kernel without weights yet.

    Raises:
        ValueError: there is no kernel of that name; the message lists those there are.
        ConfigError: what it needs is not installed.
    """
    if name not in _KERNELS:
        raise ValueError(f"kernel = {name!r} is unknown; one of: {', '.join(_KERNELS)}")
    try:
        kernel: Kernel = resolve_name(_KERNELS[name])()
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"kernel {name!r} needs {error.name}, which is not installed: pip install 'bpn-edge[float]' "
            "for float policies, or choose algorithm bpn or bqn"
        ) from error
    return kernel
