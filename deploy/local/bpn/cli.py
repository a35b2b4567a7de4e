"""The `bpn` command.

A command's module, and what it needs (torch, a web server), is loaded only when that command is given: the others
begin at once.
"""

import argparse
import importlib
import logging
import sys
from collections.abc import Sequence
from typing import NamedTuple

from bpn.errors import CommandError
from bpn_shared.errors import InputError


class Command(NamedTuple):
    """Where a command is, and what it does in a few words."""

    module: str
    help: str


COMMANDS = {
    "up": Command("up", "start the dashboard and workers"),
    "train": Command("train", "train a policy"),
    "runs": Command("runs", "list, start and stop runs"),
    "eval": Command("evaluate", "play a trained policy"),
    "verify": Command("verify", "recompute what a run says, in other code"),
    "reproduce": Command("reproduce", "make a figure or table of the paper"),
    "dashboard": Command("dashboard", "care of the dashboard's database"),
    "bench": Command("bench", "measure kernel, learner, learners, loop or dashboard"),
    "doctor": Command("doctor", "check this machine"),
}


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of the command that the arguments name; `run` is what does it."""
    parser = argparse.ArgumentParser(
        prog="bpn", description="Reinforcement learning of robot control with binarized networks."
    )
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        own = subparsers.add_parser(name, help=command.help)
        if name in arguments[:1]:
            module = importlib.import_module(f"bpn.commands.{command.module}")
            own.description = module.__doc__
            module.add_options(own)
    return parser.parse_args(arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command. Exit status: 0 done, 1 failed, 2 wrong input, 130 interrupted."""
    logging.basicConfig(
        level=logging.WARNING, format="%(levelname)s %(message)s", stream=sys.stderr
    )
    options = parse(sys.argv[1:] if argv is None else argv)
    try:
        status: int = options.run(options)
        return status
    except InputError as error:
        print(f"bpn: {error}", file=sys.stderr)
        return 2
    except CommandError as error:
        print(f"bpn: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
