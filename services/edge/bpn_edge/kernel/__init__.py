"""Kernels: what turns one observation into the outputs of a policy's network.

Each is an entry point of the group `bpn.kernels`, the project's own too; docs/own-kernel.md.
"""

from bpn_edge.kernel.protocol import Kernel
from bpn_shared import plugins

__all__ = ["Kernel", "load"]


def load(name: str) -> Kernel:
    """A kernel without weights yet.

    Raises:
        PluginError: none of that name is installed, the message lists those that are; or it cannot be made.
        ConfigError: what it needs is not installed.
    """
    kernel: Kernel = plugins.find(plugins.KERNELS, name).call()
    return kernel
