"""`bpn-certificates`: an authority and a certificate for every role, made or renewed in a folder.

Run it before the services start, as often as you like: what is good stays as it is.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from bpn_certificates.book import Book
from bpn_certificates.folders import AUTHORITY_FOLDER, SERVER_NAMES, make
from bpn_certificates.named import MACHINES_FOLDER, make_named, renew_named
from bpn_shared.bus.access import ROLES, ROUTER
from bpn_shared.bus.identity import MACHINE_ROLES, Identity
from bpn_shared.errors import InputError
from bpn_shared.version_option import add_version_option

DAYS, DAYS_AT_MOST = 365.0, 3650.0
_TAKEN = (*ROLES, AUTHORITY_FOLDER, MACHINES_FOLDER)
_FOLDER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def separated(given: Sequence[str]) -> list[str]:
    """The names of an option that may be given several times, and hold several."""
    return [name.strip() for text in given for name in text.split(",") if name.strip()]


def main(argv: list[str] | None = None) -> int:
    """Makes what is missing and says what it made. Exit status 1: the folder cannot be written."""
    parser = argparse.ArgumentParser(prog="bpn-certificates", description=__doc__)
    add_version_option(parser)
    parser.add_argument("folder", type=Path, help="gets one folder for each role")
    parser.add_argument(
        "--days", type=float, default=DAYS, help="how long they are good (default %(default)s)"
    )
    parser.add_argument(
        "--server-name",
        action="append",
        metavar="NAME",
        default=[],
        help="DNS names or addresses of the router, separated by commas, beside those that its certificate has "
        f"(default {', '.join(SERVER_NAMES)})",
    )
    parser.add_argument(
        "--router",
        metavar="FOLDER",
        default=ROUTER,
        help="the router that is meant: each site's has a folder of its own (default %(default)s)",
    )
    parser.add_argument(
        "--role",
        choices=[*MACHINE_ROLES, ROUTER],
        help="of one machine alone, in machines/NAME/ROLE; with --name",
    )
    parser.add_argument("--name", metavar="MACHINE", help="whom its certificate names")
    parser.add_argument(
        "--site",
        metavar="NAME",
        help="where it may act (default: the machine is a site of its own)",
    )
    options = parser.parse_args(argv)
    if not 0 < options.days <= DAYS_AT_MOST:
        parser.error(f"--days {options.days} must be above 0 and at most {DAYS_AT_MOST}")
    if not _FOLDER_NAME.fullmatch(options.router) or options.router in _TAKEN:
        parser.error(f"--router {options.router!r} cannot be the name of a router's folder")
    if (options.role is None) != (options.name is None) or (options.site and not options.name):
        parser.error("--role and --name belong together, and --site needs both")
    try:
        named = options.name and Identity.of(
            options.role, options.site or options.name, options.name
        )
        made = make(
            options.folder,
            days=options.days,
            server_names=separated(options.server_name),
            router=options.router,
        )
        made += renew_named(options.folder, options.days)
        if named:
            made += make_named(options.folder, named, options.days)
        Book(options.folder).tell_routers()
    except InputError as error:
        parser.error(str(error))
    except OSError as error:
        print(f"bpn-certificates: {error}", file=sys.stderr)
        return 1
    print(f"new certificates: {', '.join(made)}" if made else "all certificates are good")
    return 0
