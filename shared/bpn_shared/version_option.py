"""`--version`, which every program has."""

import argparse
from collections.abc import Sequence
from typing import Any


class _Version(argparse.Action):
    """Prints the version, which is looked up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print version, protocol and commit")

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from bpn_shared.version import describe  # noqa: PLC0415

        print(f"{parser.prog} {describe()}")
        parser.exit()


def add_version_option(parser: argparse.ArgumentParser) -> None:
    """Adds it."""
    parser.add_argument("--version", action=_Version)
