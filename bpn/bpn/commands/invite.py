"""`bpn invite`: a token with which another machine joins this one's `bpn up`, which must listen for others."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from bpn.certified import folder_of
from bpn.options import add_runs_dir
from bpn_certificates.folders import authority_in
from bpn_certificates.invitations import add_invitation_options, carry_out


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    add_invitation_options(parser)
    add_certificates(parser)
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def add_certificates(parser: argparse.ArgumentParser) -> None:
    """Which authority is meant."""
    parser.add_argument(
        "--certificates", type=Path, metavar="FOLDER",
        help="as `bpn up` was given it (default: in the runs folder)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Prints the command for the other machine.

    Raises:
        InputError: an option is wrong, or there is no authority.
    """
    folder = options.certificates or folder_of(options.runs_dir)
    authority_in(folder)
    carry_out(options, folder)
    return 0
