"""`bpn up`: everything, with the default run: the paper's reaching task."""

import argparse

from bpn.commands import train
from bpn.options import add_runs_dir


def add(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = subparsers.add_parser("up", help="start everything with the default run")
    add_runs_dir(parser)
    parser.set_defaults(run=run, task="reaching", resume=None, json=False)


def run(options: argparse.Namespace) -> int:
    """Trains the default run, attached to the terminal."""
    return train.run(options)
