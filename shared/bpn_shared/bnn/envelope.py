"""What the bytes of every policy have in common: where it comes from before it, a digest behind it.

Little-endian; a header of geometry, run, attempt, version, and one field whose meaning is the policy's; then the
policy; then the SHA-256 of all before it. Schema 2 is written: its header has the layers, and the policy begins at
a multiple of 64 bytes. Schema 1, which is read for ever, had 40 bytes of header and the paper's layers alone.
"""

import hashlib
import struct
from typing import NamedTuple
from uuid import UUID

from bpn_shared.errors import InputError
from bpn_shared.spec.network import (
    MAX_ACTION_DIMS,
    MAX_CONVOLUTIONS,
    Convolution,
    NetworkSpec,
)

SCHEMA = 2
NO_RUN = UUID(int=0)
ALIGNMENT = 64
DIGEST_BYTES = hashlib.sha256().digest_size
_START = struct.Struct("<4sH")
_ROW = struct.Struct("<HHHH")
_CHOICES = struct.Struct("<H")
_FULLY_CONNECTED = 2


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


def aligned(size: int) -> int:
    """The next multiple of 64 bytes."""
    return -(-size // ALIGNMENT) * ALIGNMENT


class Header(NamedTuple):
    """Of a policy: its geometry, where it comes from, and the field that is its own."""

    spec: NetworkSpec
    run: UUID
    attempt: int
    version: int
    own: float


class Opened(NamedTuple):
    """A header as it was read, and how: the schema, and the bytes before the policy."""

    header: Header
    schema: int
    size: int


class Envelope:
    """Of one kind of policy.

    Args:
        what: the kind, for messages.
        own: format of the field that is the kind's own, as `struct` writes it: 4 bytes.
    """

    def __init__(self, what: str, magic: bytes, own: str) -> None:
        self._what, self._magic = what, magic
        self._older = struct.Struct(f"<4sHHHH16sII{own}")
        self._fixed = struct.Struct(f"<4sHHHHHH16sII{own}4x")

    def size(self, spec: NetworkSpec, body: int) -> int:
        """Bytes of a policy with that geometry, and so many of its own."""
        return self._header_size(len(spec.layers), len(spec.action_dims)) + body + DIGEST_BYTES

    def seal(self, header: Header, body: bytes) -> bytes:
        """The policy as bytes."""
        spec = header.spec
        fixed = self._fixed.pack(
            self._magic, SCHEMA, spec.channels, spec.image_px, len(spec.layers),
            len(spec.action_dims), 0, header.run.bytes, header.attempt, header.version, header.own,
        )  # fmt: skip
        rows = (_ROW.pack(g.kernel, g.stride, g.out_channels, 0) for g in spec.layers)
        choices = map(_CHOICES.pack, spec.action_dims)
        begun = b"".join((fixed, *rows, *choices))
        data = begun.ljust(aligned(len(begun)), b"\0") + body
        return data + hashlib.sha256(data).digest()

    def open(self, data: bytes) -> Opened:
        """Reads the header, which tells how many bytes there should be.

        Raises:
            BlobError: it is none, or one of another kind or of a newer schema.
        """
        self._check_room(data, _START.size)
        magic, schema = _START.unpack_from(data)
        if magic != self._magic:
            raise BlobError(f"starts with {magic!r}, a {self._what} starts with {self._magic!r}")
        if schema == 1:
            return self._open_older(data)
        if schema != SCHEMA:
            raise BlobError(
                f"{self._what} schema {schema}, this program reads 1 and {SCHEMA}: update the older one"
            )
        return self._open_newest(data)

    def body(self, data: bytes, opened: Opened, size: int) -> bytes:
        """What is between header and digest.

        Args:
            size: of the body, as the header tells it.

        Raises:
            BlobError: truncated, oversized or altered.
        """
        expected = opened.size + size + DIGEST_BYTES
        if len(data) != expected:
            raise BlobError(f"{len(data)} bytes of a {self._what}, the header tells of {expected}")
        if hashlib.sha256(data[:-DIGEST_BYTES]).digest() != data[-DIGEST_BYTES:]:
            raise BlobError(f"SHA-256 mismatch: the {self._what} was altered on its way")
        return data[opened.size : -DIGEST_BYTES]

    def _header_size(self, layers: int, dims: int) -> int:
        return aligned(self._fixed.size + layers * _ROW.size + dims * _CHOICES.size)

    def _check_room(self, data: bytes, size: int) -> None:
        if len(data) < size:
            raise BlobError(f"{len(data)} bytes are fewer than a {self._what}'s header ({size})")

    def _open_older(self, data: bytes) -> Opened:
        self._check_room(data, self._older.size)
        _, _, channels, hidden_units, actions, run, attempt, version, own = self._older.unpack_from(
            data
        )
        spec = _spec(channels, hidden_units, actions)
        return Opened(Header(spec, UUID(bytes=run), attempt, version, own), 1, self._older.size)

    def _open_newest(self, data: bytes) -> Opened:
        self._check_room(data, self._fixed.size)
        _, _, channels, image_px, layers, dims, _, run, attempt, version, own = (
            self._fixed.unpack_from(data)
        )
        fewest, most = 1 + _FULLY_CONNECTED, MAX_CONVOLUTIONS + _FULLY_CONNECTED
        if not (fewest <= layers <= most and 1 <= dims <= MAX_ACTION_DIMS):
            raise BlobError(
                f"impossible geometry: {layers} layers and {dims} dimensions of actions; there are "
                f"{fewest}..{most} and 1..{MAX_ACTION_DIMS}"
            )
        size = self._header_size(layers, dims)
        self._check_room(data, size)
        end = self._fixed.size + layers * _ROW.size
        rows = list(_ROW.iter_unpack(data[self._fixed.size : end]))
        choices = [n for (n,) in _CHOICES.iter_unpack(data[end : end + dims * _CHOICES.size])]
        spec = _spec(
            channels, rows[-2][2], rows[-1][2],
            convolutions=tuple(Convolution(*row[:3]) for row in rows[:-_FULLY_CONNECTED]),
            image_px=image_px, action_dims=tuple(choices),
        )  # fmt: skip
        header = Header(spec, UUID(bytes=run), attempt, version, own)
        # what is derived or reserved is as it is written, or the bytes mean something else
        if self.seal(header, b"")[:size] != data[:size]:
            raise BlobError(
                "impossible geometry: the last two layers are not fully connected, or reserved bytes are not zero"
            )
        return Opened(header, SCHEMA, size)


def _spec(
    channels: int,
    hidden_units: int,
    actions: int,
    **shape: tuple[Convolution, ...] | tuple[int, ...] | int,
) -> NetworkSpec:
    try:
        return NetworkSpec(channels, hidden_units, actions, **shape)  # type: ignore[arg-type]
    except ValueError as error:
        raise BlobError(f"impossible geometry: {error}") from error
