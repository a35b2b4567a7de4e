"""A router with certificates and access control, as tests see it."""

import os
from dataclasses import dataclass
from pathlib import Path

from bpn_certificates import authority as x509
from bpn_certificates.authority import Identity, Validity
from bpn_shared.bus.certificates import AUTHORITY, CERTIFICATE, FOLDER_VARIABLE, KEY
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
