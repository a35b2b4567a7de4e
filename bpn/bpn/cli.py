"""The `bpn` command.

A command's module, and what it needs (torch, a web server), is loaded only when that command is given: the others
begin at once.
"""

import argparse
import importlib
import logging
import os
import signal
import sys
from collections.abc import Sequence
from typing import NamedTuple, NoReturn

from bpn.errors import CommandError
from bpn.terminal import spare_encoding
from bpn_shared.errors import InputError
from bpn_shared.version_option import add_version_option

EXIT_FAILED, EXIT_INPUT, EXIT_INTERRUPTED = 1, 2, 130


class Command(NamedTuple):
    """Where a command is, what it does in a few words, and how it is used."""

    module: str
    help: str
    examples: tuple[str, ...]


COMMANDS = {
    "up": Command(
        "up",
        "start the dashboard and workers",
        (
            "bpn up --first-run reaching",
            "bpn up --learners 2 --port 0",
            "bpn up --listen tls/0.0.0.0:7447",
        ),
    ),
    "join": Command(
        "join",
        "lend this machine's robots to another one's `bpn up`",
        ("bpn join TOKEN", "bpn join --robots 2"),
    ),
    "invite": Command(
        "invite",
        "make a token with which another machine joins",
        ("bpn invite --name pi-7", "bpn invite --site lab-b --minutes 10", "bpn invite --list"),
    ),
    "machines": Command(
        "machines",
        "list and remove the machines that have joined",
        ("bpn machines", "bpn machines --remove pi-7"),
    ),
    "train": Command(
        "train",
        "train a policy",
        (
            "bpn train reaching --seed 1",
            "bpn train gym:CartPole-v1 --iterations 20 --robots 2",
            "bpn train --resume RUN",
        ),
    ),
    "runs": Command(
        "runs",
        "list, start, stop and remove runs",
        (
            "bpn runs ls --sort=-return_best",
            "bpn runs show RUN",
            "bpn runs prune --keep 20 --dry-run",
        ),
    ),
    "eval": Command(
        "evaluate",
        "play a trained policy",
        ("bpn eval RUN --trials 20", "bpn eval RUN --policy softmax --video play.mp4"),
    ),
    "export": Command(
        "export",
        "write a run or its policy for others: ONNX, C, tables, ...",
        ("bpn export RUN --format onnx", "bpn export RUN --format c --output policy.c"),
    ),
    "verify": Command("verify", "recompute what a run says, in other code", ("bpn verify RUN",)),
    "reproduce": Command(
        "reproduce",
        "make a figure or table of the paper",
        ("bpn reproduce tracking --jobs 2", "bpn reproduce latency --quick"),
    ),
    "fpga": Command(
        "fpga",
        "make and measure the policy as a circuit",
        ("bpn fpga report", "bpn fpga build --target ulx3s-85f"),
    ),
    "dashboard": Command(
        "dashboard", "care of the dashboard's database", ("bpn dashboard reindex",)
    ),
    "bench": Command(
        "bench",
        "measure kernel, learner, learners, loop or dashboard",
        ("bpn bench kernel", "bpn bench loop --pace own"),
    ),
    "doctor": Command("doctor", "check this machine", ("bpn doctor",)),
}


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong: below the usage of sixty options nobody would see it."""

    def error(self, message: str) -> NoReturn:
        """Ends the program: wrong input."""
        self.exit(EXIT_INPUT, f"{self.prog}: {message}; `{self.prog} --help` has the options\n")


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of the command that the arguments name; `run` is what does it."""
    parser = Parser(
        prog="bpn",
        description="Reinforcement learning of robot control with binarized networks.",
        epilog="`bpn COMMAND --help` has a command's options. Exit status: 0 done, 1 failed, 2 wrong input, "
        "130 interrupted.",
    )
    add_version_option(parser)
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        own = subparsers.add_parser(name, help=command.help)
        if name in arguments[:1]:
            module = importlib.import_module(f"bpn.commands.{command.module}")
            own.description = module.__doc__
            own.epilog = "\n".join(["examples:", *(f"  {one}" for one in command.examples)])
            own.formatter_class = argparse.RawDescriptionHelpFormatter
            module.add_options(own, arguments[1:])
    if not arguments:
        parser.print_help(sys.stderr)
        parser.exit(EXIT_INPUT)
    return parser.parse_args(arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command. Exit status: 0 done, 1 failed, 2 wrong input, 130 interrupted."""
    # Nothing is to be put in order yet, and an exception in the middle of an import may come out as any other.
    interrupt = signal.signal(signal.SIGINT, lambda *_: os._exit(EXIT_INTERRUPTED))
    spare_encoding()
    logging.basicConfig(
        level=logging.WARNING, format="%(levelname)s %(message)s", stream=sys.stderr
    )
    try:
        options = parse(sys.argv[1:] if argv is None else argv)
    finally:
        signal.signal(signal.SIGINT, interrupt)
    try:
        status: int = options.run(options)
        return status
    except InputError as error:
        return _say(str(error), EXIT_INPUT)
    except CommandError as error:
        return _say(str(error), EXIT_FAILED)
    except OSError as error:
        return _say(_reason(error), EXIT_FAILED)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def _say(reason: str, status: int) -> int:
    print(f"bpn: {reason}", file=sys.stderr)
    return status


def _reason(error: OSError) -> str:
    """A file or a connection that failed, in one line: what, and why."""
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}"
