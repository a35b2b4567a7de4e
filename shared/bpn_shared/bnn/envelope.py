"""What the bytes of every policy have in common: where it comes from before it, a digest behind it.

Little-endian. 40 bytes of header: magic, schema version, C, N, |A|, run, attempt, version, and one field whose
meaning is the policy's; then the policy; then the SHA-256 of all before it.
"""

import hashlib
import struct
from typing import NamedTuple
from uuid import UUID

from bpn_shared.errors import InputError
from bpn_shared.spec.network import NetworkSpec

NO_RUN = UUID(int=0)
_DIGEST_BYTES = hashlib.sha256().digest_size


class BlobError(InputError):
    """The bytes or the parts are not a policy; the message says what is wrong with them."""


def check_provenance(attempt: int, version: int) -> None:
    """Whether the header has room for them.

    Raises:
        BlobError: it has not.
    """
    for name, value in (("attempt", attempt), ("version", version)):
        if not 0 <= value < 2**32:
            raise BlobError(f"{name} = {value} is outside 0..{2**32 - 1}")


class Header(NamedTuple):
    """Of a policy: its geometry, where it comes from, and the field that is its own."""

    spec: NetworkSpec
    run: UUID
    attempt: int
    version: int
    own: float


class Envelope:
    """Of one kind of policy.

    Args:
        what: the kind, for messages.
        own: format of the field that is the kind's own, as `struct` writes it: 4 bytes.
    """

    def __init__(self, what: str, magic: bytes, schema: int, own: str) -> None:
        self._what, self._magic, self._schema = what, magic, schema
        self._header = struct.Struct(f"<4sHHHH16sII{own}")

    def size(self, body: int) -> int:
        """Bytes of a policy of that many."""
        return self._header.size + body + _DIGEST_BYTES

    def seal(self, header: Header, body: bytes) -> bytes:
        """The policy as bytes."""
        spec = header.spec
        data = self._header.pack(
            self._magic, self._schema, spec.channels, spec.hidden_units, spec.actions,
            header.run.bytes, header.attempt, header.version, header.own,
        ) + body  # fmt: skip
        return data + hashlib.sha256(data).digest()

    def header(self, data: bytes) -> Header:
        """Reads the header, which tells how many bytes there should be.

        Raises:
            BlobError: it is none, or one of another kind or schema.
        """
        if len(data) < self._header.size:
            raise BlobError(
                f"{len(data)} bytes are fewer than a {self._what}'s header ({self._header.size})"
            )
        magic, schema, channels, hidden_units, actions, run, attempt, version, own = (
            self._header.unpack_from(data)
        )
        if magic != self._magic:
            raise BlobError(f"starts with {magic!r}, a {self._what} starts with {self._magic!r}")
        if schema != self._schema:
            raise BlobError(
                f"{self._what} schema {schema}, this program reads {self._schema}: update the older one"
            )
        try:
            spec = NetworkSpec(channels, hidden_units, actions)
        except ValueError as error:
            raise BlobError(f"impossible geometry: {error}") from error
        return Header(spec, UUID(bytes=run), attempt, version, own)

    def body(self, data: bytes, size: int) -> bytes:
        """What is between header and digest.

        Args:
            size: of the body, as the header tells it.

        Raises:
            BlobError: truncated, oversized or altered.
        """
        if len(data) != self.size(size):
            raise BlobError(
                f"{len(data)} bytes of a {self._what}, the header tells of {self.size(size)}"
            )
        if hashlib.sha256(data[:-_DIGEST_BYTES]).digest() != data[-_DIGEST_BYTES:]:
            raise BlobError(f"SHA-256 mismatch: the {self._what} was altered on its way")
        return data[self._header.size : -_DIGEST_BYTES]
