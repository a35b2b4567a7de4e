"""Certificates of single machines that are made here and not asked for by the machine: `machines/NAME/ROLE`."""

from pathlib import Path

from bpn_certificates import authority as x509
from bpn_certificates.authority import Identity as Pair
from bpn_certificates.authority import Validity
from bpn_certificates.book import Book
from bpn_certificates.folders import authority_in, is_good, load, store
from bpn_shared.bus.identity import Identity

MACHINES_FOLDER = "machines"


def make_named(folder: Path, identity: Identity, days: float) -> list[str]:
    """Brings one machine's certificate up to date, and has the routers admit it.

    Returns:
        The folder, below `folder`, if its certificate is new.

    Raises:
        InputError: the machine was removed.
    """
    Book(folder).admit(identity)
    return _bring_up_to_date(folder, identity, days)


def renew_named(folder: Path, days: float) -> list[str]:
    """Brings up to date all that were made here and are admitted; returns the folders that are new."""
    renewed = []
    for machine in Book(folder).machines():
        identity = machine.identity
        if identity is not None and _place(folder, identity).is_dir():
            renewed += _bring_up_to_date(folder, identity, days)
    return renewed


def _bring_up_to_date(folder: Path, identity: Identity, days: float) -> list[str]:
    place, authority = _place(folder, identity), authority_in(folder)
    present = load(place)
    if present is not None and is_good(present, authority, [], days) and _names(present, identity):
        return []
    new = x509.issue(authority, identity.common_name, Validity.of_days(days))
    store(place, new, authority)
    return [str(place.relative_to(folder))]


def _names(pair: Pair, identity: Identity) -> bool:
    return x509.common_name(pair.certificate) == identity.common_name


def _place(folder: Path, identity: Identity) -> Path:
    return folder / MACHINES_FOLDER / identity.machine / identity.role
