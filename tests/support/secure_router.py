"""A router with certificates and access control, as tests see it."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from bpn_certificates import authority as x509
from bpn_certificates.authority import Identity, Validity
from bpn_certificates.folders import make
from bpn_shared.bus.certificates import AUTHORITY, CERTIFICATE, FOLDER_VARIABLE, KEY
from bpn_shared.bus.router_config import render, secure
from bpn_shared.bus.session import Bus


@dataclass(frozen=True)
class SecureRouter:
    endpoint: str
    certificates: Path

    @property
    def authority(self) -> Identity:
        folder = self.certificates / "authority"
        return Identity.from_pem((folder / CERTIFICATE).read_bytes(), (folder / KEY).read_bytes())

    def issue(self, name: str, identity: Identity, trusted: Identity | None = None) -> Path:
        """A folder with an identity's certificate, as services expect it."""
        folder = self.certificates / name
        folder.mkdir()
        (folder / AUTHORITY).write_bytes((trusted or self.authority).certificate_pem())
        (folder / CERTIFICATE).write_bytes(identity.certificate_pem())
        (folder / KEY).write_bytes(identity.key_pem())
        return folder

    def reissue(self, role: str, validity: Validity) -> None:
        """Gives a role another certificate, good for this time."""
        identity = x509.issue(self.authority, role, validity)
        for file, content in ((KEY, identity.key_pem()), (CERTIFICATE, identity.certificate_pem())):
            (self.certificates / role / file).unlink()
            (self.certificates / role / file).write_bytes(content)

    def open_as(self, name: str, deadline_s: float = 60.0) -> Bus:
        """A session with the certificates in the folder of that name."""
        before = os.environ.get(FOLDER_VARIABLE)
        os.environ[FOLDER_VARIABLE] = str(self.certificates / name)
        try:
            return Bus(self.endpoint, deadline_s=deadline_s)
        finally:
            if before is None:
                del os.environ[FOLDER_VARIABLE]
            else:
                os.environ[FOLDER_VARIABLE] = before


@contextmanager
def secure_router(
    certificates: Path, endpoint: str, change: Callable[[Any], None]
) -> Iterator[SecureRouter]:
    """A router in a process of its own, with the generated configuration as `change` leaves it.

    Args:
        certificates: an empty folder, for those of every role.
    """
    make(certificates, days=1, server_names=["localhost"])
    config = secure(endpoint, PurePosixPath(certificates / "router"))
    change(config)
    file = certificates / "router.json5"
    file.write_text(render(config))
    process = subprocess.Popen(
        [sys.executable, "-m", "bpn_shared.bus.router", "--config", str(file)]
    )
    try:
        router = SecureRouter(endpoint, certificates)
        router.open_as("dashboard").close()  # it waits until the router is there
        yield router
    finally:
        process.terminate()
        process.wait(10)
