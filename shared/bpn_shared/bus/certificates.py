"""The certificates of a role, as a folder of three files, and what Zenoh is told about them."""

import os
from pathlib import Path
from typing import NamedTuple, Self

from bpn_shared.bus.identity import Identity
from bpn_shared.bus.x509 import facts_of
from bpn_shared.site import MAIN_SITE, check_name
from bpn_shared.spec.config import ConfigError

AUTHORITY, CERTIFICATE, KEY = "authority.pem", "certificate.pem", "key.pem"
"""Names of the files: who is trusted, who we are, and the proof of it."""
_FILES = (AUTHORITY, CERTIFICATE, KEY)

FOLDER_VARIABLE = "BPN_CERTIFICATES"
"""Environment variable: the folder of this service's certificates."""


class CertificateError(ConfigError):
    """There is no certificate where one is needed; the message says where it was looked for."""


class CertificateFiles(NamedTuple):
    """Where a service's three files are."""

    authority: Path
    certificate: Path
    key: Path

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """Under their usual names."""
        return cls(folder / AUTHORITY, folder / CERTIFICATE, folder / KEY)


def own_certificates() -> CertificateFiles | None:
    """This service's, in the folder that the environment names, if it does."""
    named = os.environ.get(FOLDER_VARIABLE)
    return CertificateFiles.in_folder(Path(named)) if named else None


def own_site(told: str | None) -> str:
    """The site of this process: what it was told, or what its certificate says.

    Raises:
        InputError: it is no site's name, or the certificate is of another one.
    """
    if told not in (None, MAIN_SITE):
        check_name(told, "--site")
    files = own_certificates()
    try:
        named = None if files is None else Identity.parse(facts_of(files.certificate).common_name)
    except (OSError, ValueError):
        named = None  # who connects with it says what is wrong
    if named is None:
        return told or MAIN_SITE
    if told not in (None, named.site):
        raise CertificateError(f"--site {told}: the certificate is of site {named.site}")
    return named.site


def client_tls(endpoint: str) -> dict[str, object]:
    """Zenoh's TLS settings of a client, from the folder that the environment names; {} without TLS.

    Raises:
        CertificateError: the endpoint needs certificates, and there are none.
    """
    if not endpoint.startswith(("tls/", "quic/")):
        return {}
    files = own_certificates()
    if files is None:
        raise CertificateError(
            f"{endpoint} needs certificates: name the folder with {', '.join(_FILES)} "
            f"in {FOLDER_VARIABLE} (`bpn-certificates` makes them)"
        )
    for path in files:
        if not os.access(path, os.R_OK):
            raise CertificateError(f"{path} cannot be read ({FOLDER_VARIABLE})")
    return {
        "root_ca_certificate": str(files.authority),
        "connect_certificate": str(files.certificate),
        "connect_private_key": str(files.key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
