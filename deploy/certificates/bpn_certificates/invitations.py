"""`bpn-invite`: tokens for machines that shall join, and who has joined.

As `bpn invite` and `bpn machines`, for where the `bpn` command is not, as in containers.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bpn_certificates.book import Book, clock
from bpn_certificates.folders import authority_in
from bpn_certificates.token import MAX_HOSTS, Token, fingerprint
from bpn_shared.bus.access import ROUTER
from bpn_shared.bus.certificates import CERTIFICATE
from bpn_shared.bus.x509 import facts_of
from bpn_shared.errors import InputError
from bpn_shared.site import MAIN_SITE, check_name
from bpn_shared.version_option import add_version_option

LIFETIME_S = 3600.0
LIFETIME_AT_MOST_S = 7 * 86_400.0


def invite(
    folder: Path,
    *,
    hosts: Sequence[str] = (),
    machine: str | None = None,
    site: str | None = None,
    lifetime_s: float = LIFETIME_S,
) -> str:
    """A token, good for one machine and for that time.

    Args:
        hosts: by which the machine reaches this one; none: as whoever admits machines has noted.
        machine: the name that it is for; None: the machine says its own.
        site: where it will be; None: it is a site of its own.

    Raises:
        InputError: a name cannot be one, or is taken; or there is no authority.
    """
    if not 0 < lifetime_s <= LIFETIME_AT_MOST_S:
        raise InputError(
            f"a token is good for more than 0 and at most {LIFETIME_AT_MOST_S / 60:.0f} minutes"
        )
    if machine is not None:
        check_name(machine, "--name")
    if site is not None and check_name(site, "--site") == MAIN_SITE:
        raise InputError(f"--site {site}: that is the router's own; choose another name")
    authority = authority_in(folder)
    book = Book(folder)
    door = book.door()
    if door is None:
        raise InputError(
            "nobody admits machines here yet: start `bpn up --listen tls/0.0.0.0:7447` (or `bpn-enrolment`) first"
        )
    reached = tuple(hosts or door.hosts)[:MAX_HOSTS]
    named = facts_of(folder / ROUTER / CERTIFICATE).server_names
    if unknown := [host for host in reached if host not in named]:
        raise InputError(
            f"the router's certificate is not for {', '.join(unknown)}: "
            f"bpn-certificates {folder} --server-name {unknown[0]}"
        )
    secret = book.invite(machine, site, lifetime_s)
    return str(Token(reached, door.port, fingerprint(authority.certificate), secret))


def lines_of_invitations(book: Book) -> list[str]:
    """The open ones, one a line."""
    return [
        f"{one.id}  for {one.machine or 'any name'}  at {one.site or 'a site of its own'}  "
        f"until {clock(one.ends_unix_s)}"
        for one in book.invitations()
    ]


def lines_of_machines(book: Book) -> list[str]:
    """Those that have joined, one a line."""
    machines = [(one, one.identity) for one in book.machines()]
    return [
        f"{identity.machine}  {identity.role} of site {identity.site}  since {clock(one.joined_unix_s)}"
        for one, identity in machines
        if identity is not None
    ]


def add_invitation_options(parser: argparse.ArgumentParser) -> None:
    """What an invitation is for, and what else can be done with them."""
    parser.add_argument("--name", help="the machine's (default: it says its own)")
    parser.add_argument(
        "--host", action="append", metavar="NAME", default=[],
        help="by which the machine reaches this one (default: as `bpn up` says)",
    )  # fmt: skip
    parser.add_argument(
        "--site", metavar="NAME", help="where it will be (default: a site of its own)"
    )
    parser.add_argument(
        "--minutes", type=float, default=LIFETIME_S / 60, help="how long it is good (%(default)g)"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="show the invitations that are open")
    what.add_argument("--revoke", metavar="ID", help="end one of them")


def carry_out(options: argparse.Namespace, folder: Path) -> None:
    """Does what `add_invitation_options` offers, and prints it."""
    authority_in(folder)
    if options.list:
        print("\n".join(lines_of_invitations(Book(folder))) or "no invitations are open")
    elif options.revoke is not None:
        Book(folder).revoke(options.revoke)
        print(f"revoked {options.revoke}")
    else:
        lifetime_s = options.minutes * 60
        token = invite(
            folder,
            hosts=options.host,
            machine=options.name,
            site=options.site,
            lifetime_s=lifetime_s,
        )
        print(f"bpn join {token}")


def main(argv: list[str] | None = None) -> int:
    """Exit status: 0 done, 2 wrong input."""
    parser = argparse.ArgumentParser(prog="bpn-invite", description=__doc__)
    add_version_option(parser)
    parser.add_argument("folder", type=Path, help="what `bpn-certificates` made")
    add_invitation_options(parser)
    parser.add_argument("--machines", action="store_true", help="show who has joined")
    parser.add_argument("--remove", metavar="NAME", help="let a machine do nothing any more")
    options = parser.parse_args(argv)
    try:
        if options.machines:
            print("\n".join(lines_of_machines(Book(options.folder))) or "no machine has joined")
        elif options.remove is not None:
            print(f"removed {', '.join(Book(options.folder).remove(options.remove))}")
        else:
            carry_out(options, options.folder)
    except (InputError, OSError) as error:
        print(f"bpn-invite: {error}", file=sys.stderr)
        return 2
    return 0
