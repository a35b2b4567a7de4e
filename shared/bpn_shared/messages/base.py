"""The form of the messages that are msgpack maps, and the one error of all decoders."""

from collections.abc import Collection
from typing import Any, ClassVar, Self

import msgpack
from pydantic import BaseModel, ConfigDict, ValidationError

from bpn_shared.version import VERSION

MAX_CONTROL_BYTES = 64 * 1024
ULONG = 2**64
LONGEST_NS = 2**32 - 1
"""Of durations on the wire, 4.3 s: what took longer, as of a process that was frozen, is told as this."""


class MessageError(ValueError):
    """Bytes from the wire are not the message they should be; the message says in what way."""


class OtherVersionError(MessageError):
    """The bytes are of a schema that this program does not read: not damaged, but somebody else's version."""


def check_size(kind: str, data: bytes, limit: int) -> None:
    """Refuses oversized input before anything parses it.

    Raises:
        MessageError: more than `limit` bytes.
    """
    if len(data) > limit:
        raise MessageError(f"{kind}: {len(data)} bytes, the limit is {limit}")


def unpack_map(kind: str, data: bytes, schemas: Collection[int]) -> tuple[int, dict[str, Any]]:
    """The schema version of a msgpack map, which must be one of `schemas`, and its other entries.

    Raises:
        OtherVersionError: another schema version.
        MessageError: not msgpack, not a map, or no schema version.
    """
    try:
        fields = msgpack.unpackb(data, raw=False, strict_map_key=True)
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"{kind}: not msgpack: {error or type(error).__name__}") from error
    if not isinstance(fields, dict):
        raise MessageError(f"{kind}: a {type(fields).__name__} where a map is expected")
    found = fields.pop("schema", None)
    if not isinstance(found, int) or isinstance(found, bool):
        raise MessageError(f"{kind}: schema {found!r} is no number")
    if found not in schemas:
        known = ", ".join(map(str, sorted(schemas)))
        raise OtherVersionError(
            f"{kind}: schema {found}, this program (bpn {VERSION}) reads {known}: install the same version"
        )
    return found, fields


class Message(BaseModel):
    """A small message: a msgpack map of validated fields.

    A field that a later schema added has a default, which stands in for it when an older one is read.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
    SCHEMA: ClassVar[int] = 1
    OLDER_SCHEMAS: ClassVar[frozenset[int]] = frozenset()
    """That can be read too."""

    def encode(self) -> bytes:
        """The message as bytes."""
        packed: bytes = msgpack.packb({"schema": self.SCHEMA, **self.model_dump()})
        return packed

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Reads `encode`'s bytes.

        Raises:
            OtherVersionError: a schema that this program does not read.
            MessageError: oversized, not this message, or a field is outside its range.
        """
        check_size(cls.__name__, data, MAX_CONTROL_BYTES)
        _, fields = unpack_map(cls.__name__, data, {cls.SCHEMA} | cls.OLDER_SCHEMAS)
        try:
            return cls.model_validate(fields)
        except ValidationError as error:
            first = error.errors()[0]
            name = ".".join(map(str, first["loc"])) or "content"
            raise MessageError(f"{cls.__name__}: {name}: {first['msg']}") from error
