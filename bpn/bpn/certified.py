"""What services on this machine need where the router asks for certificates: a folder for each role."""

from collections.abc import Mapping
from pathlib import Path

from bpn_shared.bus.access import ROLES, ROUTER
from bpn_shared.bus.certificates import CERTIFICATE, FOLDER_VARIABLE, CertificateFiles
from bpn_shared.bus.obstacle import own_obstacle
from bpn_shared.bus.x509 import facts_of
from bpn_shared.errors import InputError


def environment(certificates: Path | None, role: str) -> Mapping[str, str]:
    """Environment variables that lead a service to the certificates of its role."""
    return {} if certificates is None else {FOLDER_VARIABLE: str((certificates / role).absolute())}


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
