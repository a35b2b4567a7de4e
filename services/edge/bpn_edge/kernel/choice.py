"""Which kernel runs a run's policy at this edge: the edge's own choice, as far as the run does not ask for one.

Whoever sets an edge up says what it has, by an option or the environment. So runs of a pool may mix an FPGA and
CPUs: a run that asks for no kernel takes every edge as it is. A run that asks for one is played by edges that were
set up with it, or with nothing; others give it back to the registry, which offers it to the next.
"""

import argparse
import os
import re
from collections.abc import Sequence

from bpn_shared import plugins
from bpn_shared.errors import InputError
from bpn_shared.spec.algorithms import KERNELS, NAME_PATTERN, NetworkKind
from bpn_shared.spec.config import ConfigError

OPTION, VARIABLE = "--kernel", "BPN_KERNEL"


def add_kernel(parser: argparse.ArgumentParser) -> None:
    """Adds the option."""
    parser.add_argument(
        OPTION,
        metavar="NAMES",
        default="",
        help="what runs policies at this edge: kernels that are installed, of several those in front first "
        f"(also: environment variable {VARIABLE}; default: as each run asks, else native or onnx)",
    )


def kernels_here(given: str = "") -> tuple[str, ...]:
    """What the option, as it was given, or else the environment variable names, in order; often nothing.

    Raises:
        InputError: one is no name.
        PluginError: one is not installed.
    """
    whence = OPTION if given else VARIABLE
    names = [name for name in re.split(r"[,\s]+", given or os.environ.get(VARIABLE, "")) if name]
    for name in names:
        if not re.fullmatch(NAME_PATTERN, name):
            raise InputError(f"{whence}: {name!r} is no name of a kernel")
        plugins.find(plugins.KERNELS, name)
    return tuple(dict.fromkeys(names))


def choose_kernel(asked: str, network: NetworkKind, here: Sequence[str]) -> str:
    """The kernel for a run.

    Args:
        asked: what the run asks for; "": nothing.
        network: what it has to run.
        here: what this edge was set up with.

    Raises:
        ConfigError: this edge was set up with others, or what is asked for runs no such network; the message says
            what to do.
    """
    if asked:
        if here and asked not in here:
            raise ConfigError(
                f"the run asks for kernel {asked!r}, this edge was set up with {', '.join(here)} ({OPTION} or "
                f"{VARIABLE}): start an edge with {asked}, or leave the run's kernel out"
            )
        if network_of(asked) != network:
            raise ConfigError(
                f"kernel = {asked!r} runs {network_of(asked)} networks, the run's is {network}: "
                "choose another kernel, or leave it out"
            )
        return asked
    if not here:
        return KERNELS[network][0]
    for name in here:
        if network_of(name) == network:
            return name
    raise ConfigError(
        f"the run has a {network} network, and none of the kernels that this edge was set up with runs one: "
        f"{', '.join(here)} ({OPTION} or {VARIABLE}); add one that does, such as {KERNELS[network][0]}"
    )


def network_of(kernel: str) -> NetworkKind:
    """What an installed kernel runs: its class says `network`, binary where it says nothing.

    Raises:
        PluginError: it is not installed, or broken.
    """
    for network, names in KERNELS.items():
        if kernel in names:
            return network
    found = getattr(plugins.load(plugins.KERNELS, kernel), "network", "binary")
    return "float" if found == "float" else "binary"
