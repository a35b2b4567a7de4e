"""The certificates of a role, as a folder of three files, and what Zenoh is told about them."""

import os
from pathlib import Path

from bpn_shared.config import ConfigError

AUTHORITY, CERTIFICATE, KEY = "authority.pem", "certificate.pem", "key.pem"
"""Names of the files: who is trusted, who we are, and the proof of it."""
_FILES = (AUTHORITY, CERTIFICATE, KEY)

FOLDER_VARIABLE = "BPN_CERTIFICATES"
"""Environment variable: the folder of this service's certificates."""


class CertificateError(ConfigError):
    """There is no certificate where one is needed; the message says where it was looked for."""


def client_tls(endpoint: str) -> dict[str, object]:
    """Zenoh's TLS settings of a client, from the folder that the environment names; {} without TLS.

    Raises:
        CertificateError: the endpoint needs certificates, and there are none.
    """
    if not endpoint.startswith(("tls/", "quic/")):
        return {}
    named = os.environ.get(FOLDER_VARIABLE)
    if not named:
        raise CertificateError(
            f"{endpoint} needs certificates: name the folder with {', '.join(_FILES)} "
            f"in {FOLDER_VARIABLE} (`bpn-certificates` makes them)"
        )
    folder = Path(named)
    for name in _FILES:
        if not os.access(folder / name, os.R_OK):
            raise CertificateError(f"{folder / name} cannot be read ({FOLDER_VARIABLE})")
    return {
        "root_ca_certificate": str(folder / AUTHORITY),
        "connect_certificate": str(folder / CERTIFICATE),
        "connect_private_key": str(folder / KEY),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
