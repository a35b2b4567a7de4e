"""Which modules of somebody else a machine imports for `gym:` tasks: those that whoever runs it has named.

A configuration comes over the bus, from anybody who may start runs. So it never makes a robot import at will.
"""

import argparse
import os
import re
from collections.abc import Collection

from bpn_shared.errors import InputError
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.gym import MODULE, GymOptions, modules_named

OPTION, VARIABLE = "--allow-gym-modules", "BPN_GYM_MODULES"


def add_gym_modules(parser: argparse.ArgumentParser) -> None:
    """Adds the option."""
    parser.add_argument(
        OPTION,
        dest="gym_modules",
        metavar="MODULES",
        default="",
        help="Python modules that gym: tasks may import here, with all in them, separated by commas "
        f"(also: environment variable {VARIABLE})",
    )


def allowed_modules(given: str = "") -> frozenset[str]:
    """What the option, as it was given, and the environment variable name.

    Raises:
        InputError: one is no module's name.
    """
    allowed = set()
    for whence, text in ((OPTION, given), (VARIABLE, os.environ.get(VARIABLE, ""))):
        for name in re.split(r"[,\s]+", text.strip()):
            if name and not re.fullmatch(MODULE, name):
                raise InputError(f"{whence}: {name!r} is no name of a Python module")
            allowed.add(name)
    return frozenset(allowed - {""})


def allow_here(modules: Collection[str]) -> None:
    """Makes the environment variable name these, for whatever makes robots in this process."""
    os.environ[VARIABLE] = ",".join(sorted(modules))


def as_arguments(modules: Collection[str]) -> list[str]:
    """The option for a process that may import these."""
    return [OPTION, ",".join(sorted(modules))] if modules else []


def check_allowed(task: str, options: GymOptions, allowed: Collection[str]) -> None:
    """Refuses a task that needs a module which is not allowed; a module allows those inside it.

    Raises:
        ConfigError: the message names module, option and environment variable.
    """
    for module in modules_named(task, options.env_wrappers):
        parts = module.split(".")
        if not any(".".join(parts[:length]) in allowed for length in range(1, len(parts) + 1)):
            raise ConfigError(
                f"{task} needs the module {module!r}, which is not allowed here: start robots (or this "
                f"command) with {OPTION} {parts[0]}, or set {VARIABLE}={parts[0]}, if you "
                "trust what it does when it is imported"
            )
