"""`bpn machines`: the machines that have joined with `bpn join`, and an end to that."""

import argparse
from collections.abc import Sequence

from bpn.certified import folder_of
from bpn.commands.invite import add_certificates
from bpn.options import add_runs_dir
from bpn_certificates.book import Book
from bpn_certificates.folders import authority_in
from bpn_certificates.invitations import lines_of_machines


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument(
        "--remove", metavar="NAME", help="let a machine do nothing any more, and never again"
    )
    add_certificates(parser)
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Lists them, or removes one: the router lets it do nothing from then on.

    Raises:
        InputError: there is no authority, or no machine of that name.
    """
    folder = options.certificates or folder_of(options.runs_dir)
    authority_in(folder)
    book = Book(folder)
    if options.remove is not None:
        print(f"removed {', '.join(book.remove(options.remove))}")
        return 0
    print("\n".join(lines_of_machines(book)) or "no machine has joined")
    return 0
