"""`bpn reproduce`: a figure or table of the paper, from its runs to its plot, by one command.

Interrupt it whenever you like: the same command goes on where it stopped, and makes no finished run again.
"""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from bpn import optional
from bpn.options import refuse_old_name
from bpn.outputs import check_runs_dir
from bpn_shared.errors import InputError
from bpn_shared.runtime.service import stop_on_signals
from bpn_shared.spec.algorithms import algorithm_names

_RESULTS = Path("docs/results")
NAMES = (
    "reaching",
    "tracking",
    "heatmap",
    "pan-tilt",
    "inference",
    "latency",
    "averaging",
    "cartpole",
    "robustness",
    "robustness-pan-tilt",
)


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument("target", metavar="TARGET", choices=NAMES, help=", ".join(NAMES))
    parser.add_argument("--seeds", type=int, help="runs of each configuration (default 5; quick 2)")
    parser.add_argument(
        "--first-seed",
        type=int,
        help="their seeds begin with it (default 0); others than those that presets were chosen on, say",
    )
    parser.add_argument("--jobs", type=int, default=1, help="runs side by side (default 1)")
    parser.add_argument(
        "--algorithms",
        metavar="A,B",
        help=f"some of the target's algorithms, of {','.join(algorithm_names())} (default all)",
    )
    parser.add_argument(
        "--hidden-units",
        metavar="N,N",
        help="some of the target's N, where it compares several (default all)",
    )
    refuse_old_name(parser, "nodes")
    parser.add_argument(
        "--iterations", type=int, help="shorter or longer runs than the task's preset has them"
    )
    parser.add_argument(
        "--quick", action="store_true", help="a tiny version, to see that everything works"
    )
    parser.add_argument(
        "--redraw",
        action="store_true",
        help="only draw figure and table anew from the results in OUT; nothing is run",
    )
    parser.add_argument(
        "--out", type=Path, help="for the results (default docs/results; quick: RUNS_DIR/quick)"
    )
    parser.add_argument(
        "--runs-dir",
        type=Path,
        default=Path("runs/reproduce"),
        help="for runs and trials (default %(default)s)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Makes the target; exit status 130 if interrupted."""
    for name in ("seeds", "jobs", "iterations"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise InputError(f"--{name} = {value} must be at least 1")
    if options.first_seed is not None and options.first_seed < 0:
        raise InputError(f"--first-seed = {options.first_seed} must be at least 0")
    out_dir = options.out or (options.runs_dir / "quick" if options.quick else _RESULTS)
    making: Any = optional.load("bpn.reproduce.build", extra="media", wanted_by="`bpn reproduce`")
    if options.redraw:
        _check_redraw(options)
        return int(making.redraw(options.target, out_dir, Console()))
    check_runs_dir(options.runs_dir)
    return int(
        making.make(
            options.target,
            seeds=options.seeds,
            algorithms=None if options.algorithms is None else options.algorithms.split(","),
            hidden_units=None if options.hidden_units is None else _integers(options.hidden_units),
            iterations=options.iterations,
            first_seed=options.first_seed or 0,
            quick=options.quick,
            jobs=options.jobs,
            out_dir=out_dir,
            runs_dir=options.runs_dir,
            command=_command(options),
            stop=stop_on_signals(),
            out=Console(),
        )
    )


def _check_redraw(options: argparse.Namespace) -> None:
    for name in ("seeds", "first_seed", "algorithms", "hidden_units", "iterations"):
        if getattr(options, name) is not None:
            option = name.replace("_", "-")
            raise InputError(
                f"--redraw draws all that the results hold, so --{option} says nothing: leave it out"
            )


def _integers(text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise InputError(
            f"--hidden-units = {text!r} must be integers with commas between them"
        ) from None


def _command(options: argparse.Namespace) -> str:
    """What to type to get the same."""
    words = ["bpn", "reproduce", options.target]
    for name in ("seeds", "first_seed", "jobs", "algorithms", "hidden_units", "iterations"):
        value = getattr(options, name)
        words += [] if value is None else [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join([*words, *(["--quick"] if options.quick else [])])
