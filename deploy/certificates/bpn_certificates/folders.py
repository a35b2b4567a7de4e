"""Certificates as folders, one for each role: made where they are missing, renewed before they end."""

import datetime
import os
from collections.abc import Sequence
from pathlib import Path

from bpn_certificates import authority as x509
from bpn_certificates.authority import Identity, Validity
from bpn_shared.bus.access import ROLES, ROUTER
from bpn_shared.bus.certificates import AUTHORITY, CERTIFICATE, KEY
from bpn_shared.errors import InputError

AUTHORITY_FOLDER = "authority"
AUTHORITY_DAYS = 3650.0
SERVER_NAMES = ("router", "localhost", "127.0.0.1")
"""Of a router that nobody named: as compose calls it, and on its own machine."""


def make(
    folder: Path, *, days: float, server_names: Sequence[str] = (), router: str = ROUTER
) -> list[str]:
    """Brings the folders of all roles up to date, and those of further routers that were made before.

    A certificate is made anew when it is missing, damaged, not of this authority, lacks a server name, or when
    less than a quarter of `days` is left of it.

    Args:
        folder: holds a folder for the authority, which only who makes certificates may read, and one
            for each role, with the authority's certificate, its own and its key.
        days: how long a certificate is good.
        server_names: by which clients reach the router, beside the names that its certificate has already; those
            of `SERVER_NAMES` if it would have none.
        router: the folder of the router that these names are for; each site's router has its own.

    Returns:
        The folders whose certificates are new; `authority` first if that is.
    """
    renewed: list[str] = []
    authority = load(folder / AUTHORITY_FOLDER)
    if authority is None or _days_left(authority) < days:
        authority = x509.new_authority("bpn authority", Validity.of_days(AUTHORITY_DAYS))
        store(folder / AUTHORITY_FOLDER, authority, authority)
        renewed.append(AUTHORITY_FOLDER)
    routers = _routers(folder) | {router: set(server_names) | _names(folder / router)}
    for name in (*routers, *ROLES):
        names = sorted(routers[name] or SERVER_NAMES) if name in routers else []
        present = load(folder / name)
        if present is None or not is_good(present, authority, names, days):
            role = ROUTER if name in routers else name
            new = x509.issue(authority, role, Validity.of_days(days), server_names=names)
            store(folder / name, new, authority)
            renewed.append(name)
    return renewed


def router_folders(folder: Path) -> list[Path]:
    """Those of all routers."""
    return [folder / name for name in _routers(folder)]


def authority_in(folder: Path) -> Identity:
    """The authority that was made there.

    Raises:
        InputError: there is none.
    """
    authority = load(folder / AUTHORITY_FOLDER)
    if authority is None:
        raise InputError(
            f"{folder} has no authority: `bpn up --listen tls/0.0.0.0:7447` or `bpn-certificates` makes one"
        )
    return authority


def _routers(folder: Path) -> dict[str, set[str]]:
    """The folders of routers that were made before, and the names of each."""
    found = {path.name: _names(path) for path in sorted(folder.glob("*")) if path.is_dir()}
    return {name: names for name, names in found.items() if names}


def _names(folder: Path) -> set[str]:
    """The server names of the certificate in a folder, whatever else is wrong with it."""
    identity = load(folder)
    return set() if identity is None else x509.server_names(identity.certificate)


def is_good(identity: Identity, authority: Identity, names: Sequence[str], days: float) -> bool:
    """Whether a certificate may stay as it is: of this authority, for these server names, and not near its end."""
    return (
        x509.is_issued_by(identity.certificate, authority.certificate)
        and x509.server_names(identity.certificate) == set(names)
        and _days_left(identity) > days / 4
    )


def _days_left(identity: Identity) -> float:
    left = identity.certificate.not_valid_after_utc - datetime.datetime.now(datetime.UTC)
    return left / datetime.timedelta(days=1)


def load(folder: Path) -> Identity | None:
    """The identity in a folder; None if there is none that can be used."""
    try:
        return Identity.from_pem((folder / CERTIFICATE).read_bytes(), (folder / KEY).read_bytes())
    except (FileNotFoundError, ValueError):
        return None


def store(folder: Path, identity: Identity, authority: Identity) -> None:
    """Writes a role's three files, each of them whole, the key readable by its owner alone."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _write(folder / KEY, identity.key_pem(), 0o400)
    _write(folder / AUTHORITY, authority.certificate_pem(), 0o444)
    _write(folder / CERTIFICATE, identity.certificate_pem(), 0o444)


def _write(path: Path, content: bytes, mode: int) -> None:
    new = path.with_suffix(".new")
    new.unlink(missing_ok=True)
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(descriptor)
    new.replace(path)
