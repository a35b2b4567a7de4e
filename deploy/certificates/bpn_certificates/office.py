"""Decides which machine gets a certificate, without a network."""

import base64
from pathlib import Path
from typing import Any, NamedTuple

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from bpn_certificates import authority as x509
from bpn_certificates.authority import Validity, key_digest, requested_key
from bpn_certificates.book import Book, JoinRefusedError
from bpn_certificates.folders import authority_in
from bpn_shared.bus.identity import Identity
from bpn_shared.site import check_name

DAYS = 365.0


class Admitted(NamedTuple):
    """What a machine gets."""

    identity: Identity
    certificate_pem: bytes


class Office:
    """Of the authority in a folder.

    Args:
        folder: the authority's, with everybody's.
        days: how long a machine's certificate is good.
    """

    def __init__(self, folder: Path, days: float = DAYS) -> None:
        self._folder, self._days = folder, days
        self._book = Book(folder)

    def authority_pem(self) -> bytes:
        """The authority's certificate, which is no secret."""
        return authority_in(self._folder).certificate_pem()

    def admit(self, body: dict[str, Any]) -> Admitted:
        """A certificate for a machine that brings a token's secret.

        Raises:
            JoinRefusedError: it is not admitted.
            InputError, ValueError, KeyError, TypeError: the request is none.
        """
        key = requested_key(body["request"].encode())
        secret = base64.b64decode(body["secret"], validate=True)
        name = check_name(body["name"], "name")
        identity, certificate = self._book.redeem(
            secret, name, key_digest(key), lambda machine: self._sign(machine, key)
        )
        return Admitted(identity, certificate)

    def renew(self, common_name: str, body: dict[str, Any]) -> Admitted:
        """A new certificate for a machine that showed a good one.

        Raises:
            JoinRefusedError: it has been removed.
            ValueError, KeyError, TypeError: the request is none.
        """
        identity = Identity.parse(common_name)
        if identity is None or not self._book.is_admitted(common_name):
            raise JoinRefusedError(f"{common_name or 'who shows no certificate'} is not admitted")
        certificate = self._sign(identity, requested_key(body["request"].encode()))
        self._book.note("renewed", machine=common_name)
        return Admitted(identity, certificate)

    def _sign(self, identity: Identity, key: ec.EllipticCurvePublicKey) -> bytes:
        certificate = x509.certify(
            authority_in(self._folder), identity.common_name, key, Validity.of_days(self._days)
        )
        return certificate.public_bytes(serialization.Encoding.PEM)
