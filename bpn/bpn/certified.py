"""What services on this machine need where the router asks for certificates: a folder for each role."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from bpn.addresses import own_addresses
from bpn_certificates.book import Book
from bpn_certificates.command import DAYS
from bpn_certificates.folders import AUTHORITY_FOLDER, SERVER_NAMES, make
from bpn_certificates.token import MAX_HOSTS
from bpn_shared.bus.access import ROLES, ROUTER
from bpn_shared.bus.certificates import CERTIFICATE, FOLDER_VARIABLE, KEY, CertificateFiles
from bpn_shared.bus.endpoint import network
from bpn_shared.bus.obstacle import own_obstacle
from bpn_shared.bus.x509 import facts_of
from bpn_shared.errors import InputError

LOCAL_NAMES = ("localhost", "127.0.0.1")
_EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - recognised, not listened at


def environment(certificates: Path | None, role: str) -> Mapping[str, str]:
    """Environment variables that lead a service to the certificates of its role."""
    return {} if certificates is None else {FOLDER_VARIABLE: str((certificates / role).absolute())}


def folder_of(runs_dir: Path) -> Path:
    """Where `bpn up` keeps certificates that nobody else has made."""
    return runs_dir / ".certificates"


def prepare(folder: Path, listen: str, server_names: Sequence[str]) -> None:
    """Makes an authority and all certificates where there are none, and renews what is near its end.

    Args:
        listen: the router's endpoint.
        server_names: by which other machines reach this one; none: its own addresses.
    """
    parts = network(listen)
    host = "" if parts is None else parts.host
    everywhere = host in _EVERYWHERE
    reached = [*server_names] or (own_addresses() if everywhere else [])
    names = {*reached, *LOCAL_NAMES, *([] if everywhere or not host else [host])}
    make(folder, days=DAYS, server_names=sorted(names))
    Book(folder).tell_routers()


def hosts(folder: Path, server_names: Sequence[str] = ()) -> tuple[str, ...]:
    """How other machines reach the router: its certificate's names, those that were given, or this machine's
    addresses of now, before others.
    """
    names = facts_of(folder / ROUTER / CERTIFICATE).server_names - {*LOCAL_NAMES, *SERVER_NAMES}
    first = [name for name in (*server_names, *own_addresses()) if name in names]
    ordered = dict.fromkeys([*first, *sorted(names)])
    return tuple(ordered)[:MAX_HOSTS] or ("localhost",)


def can_sign(folder: Path) -> bool:
    """Whether the authority's key is there."""
    return (folder / AUTHORITY_FOLDER / KEY).exists()


def local_endpoint(listen: str) -> str:
    """How services on this machine reach a router that listens there, if need be at every address."""
    return listen.replace("/0.0.0.0:", "/localhost:").replace("/[::]:", "/localhost:")


def check(certificates: Path, listen: str) -> None:
    """Looks whether all roles' certificates can be used, and the router's for how services here call it.

    Raises:
        InputError: they cannot; the message says which, why, and what makes them.
    """
    remedy = f"`bpn-certificates {certificates} --server-name NAME` makes what is needed"
    for role in (ROUTER, *ROLES):
        if reason := own_obstacle(CertificateFiles.in_folder(certificates / role)):
            raise InputError(f"--certificates: {reason}; {remedy}")
    names = facts_of(certificates / ROUTER / CERTIFICATE).server_names
    wanted = local_endpoint(listen).partition("/")[2].rpartition(":")[0].strip("[]")
    if wanted not in names:
        raise InputError(
            f"the router's certificate is for {', '.join(sorted(names))}, and services here would call it "
            f"{wanted}: bpn-certificates {certificates} --server-name {wanted}"
        )
