"""What a machine needs to join, in one word: where, whom to trust there, and a secret that is good once."""

import base64
import binascii
import hashlib
import zlib
from typing import NamedTuple, Self

import msgpack
from cryptography import x509
from cryptography.hazmat.primitives import hashes

from bpn_shared.errors import InputError

SECRET_BYTES = 16
_PREFIX = "bpn1-"
_CHECK_BYTES = 4
MAX_HOSTS = 8
_LONGEST = 2000


def fingerprint(authority: x509.Certificate) -> bytes:
    """SHA-256 of an authority's certificate."""
    return authority.fingerprint(hashes.SHA256())


def digest(secret: bytes) -> str:
    """What is kept of a secret."""
    return hashlib.sha256(secret).hexdigest()


class Token(NamedTuple):
    """Attributes:
    hosts: names and addresses of the machine to join, to be tried in this order.
    port: where it admits machines.
    authority: the fingerprint of its authority, so that the first contact is with it and nobody else.
    secret: what it knows the invitation by.
    """

    hosts: tuple[str, ...]
    port: int
    authority: bytes
    secret: bytes

    def __str__(self) -> str:
        body = msgpack.packb([list(self.hosts), self.port, self.authority, self.secret])
        checked = body + zlib.crc32(body).to_bytes(_CHECK_BYTES)
        return _PREFIX + base64.urlsafe_b64encode(checked).decode().rstrip("=")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads what `str` wrote.

        Raises:
            InputError: it is none, or not whole.
        """
        try:
            if not text.startswith(_PREFIX) or len(text) > _LONGEST:
                raise ValueError(text)
            word = text.removeprefix(_PREFIX)
            data = base64.b64decode(word + "=" * (-len(word) % 4), altchars=b"-_", validate=True)
            body, check = data[:-_CHECK_BYTES], data[-_CHECK_BYTES:]
            if zlib.crc32(body).to_bytes(_CHECK_BYTES) != check:
                raise ValueError(text)
            hosts, port, authority, secret = msgpack.unpackb(body)
            token = cls(tuple(map(str, hosts)), int(port), bytes(authority), bytes(secret))
        except (ValueError, TypeError, binascii.Error, msgpack.UnpackException) as error:
            raise InputError(
                f"{text[:20]!r}... is no token, or not whole: copy it as `bpn up` or `bpn invite` printed it"
            ) from error
        return token
