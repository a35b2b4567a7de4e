"""`bpn-certificates`: an authority and a certificate for every role, made or renewed in a folder.

Run it before the services start, as often as you like: what is good stays as it is.
"""

import argparse
import sys
from pathlib import Path

from bpn_certificates.folders import make

DAYS = 365.0
SERVER_NAMES = ("router", "localhost", "127.0.0.1")


def main(argv: list[str] | None = None) -> int:
    """Makes what is missing and says what it made. Exit status 1: the folder cannot be written."""
    parser = argparse.ArgumentParser(prog="bpn-certificates", description=__doc__)
    parser.add_argument("folder", type=Path, help="gets one folder for each role")
    parser.add_argument(
        "--days", type=float, default=DAYS, help="how long they are good (default %(default)s)"
    )
    parser.add_argument(
        "--server-name",
        action="append",
        metavar="NAME",
        help=f"a DNS name or address of the router (default {', '.join(SERVER_NAMES)})",
    )
    options = parser.parse_args(argv)
    try:
        made = make(
            options.folder, days=options.days, server_names=options.server_name or SERVER_NAMES
        )
    except OSError as error:
        print(f"bpn-certificates: {error}", file=sys.stderr)
        return 1
    print(f"new certificates: {', '.join(made)}" if made else "all certificates are good")
    return 0
