"""The WebSocket's messages, version 1 (docs/live.md): JSON both ways, camera frames as binary from the server.

Pure: from text and bytes to values and back.
"""

import struct
from typing import Annotated, Literal, NamedTuple

import orjson
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

VERSION = 1
CREDIT = 2
"""Camera frames that may be on their way to a client, sent and not acknowledged."""
MAX_CLIENT_MESSAGE_BYTES = 4096

FRAME_RAW, FRAME_JPEG = 1, 2
_FRAME_HEADER = struct.Struct("<BBHIddHHHH")
FRAME_HEADER_BYTES = _FRAME_HEADER.size

SubscriptionId = Annotated[int, Field(ge=0, le=0xFFFF)]


class ProtocolError(ValueError):
    """What came is not protocol version 1; the message names the value.

    Attributes:
        subscription: the subscription that it is about, if that is known.
    """

    def __init__(self, message: str, subscription: int | None = None) -> None:
        super().__init__(message)
        self.subscription = subscription


class _ClientMessage(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Hello(_ClientMessage):
    """The first message."""

    op: Literal["hello"]
    proto: int


class Subscribe(_ClientMessage):
    """From now on this topic, at most `rate_hz` messages a second.

    Attributes:
        id: the client's name for the subscription; free when it is not in use.
        since: topics that keep what came: begin after this sequence number; None: with what comes next.
    """

    op: Literal["sub"]
    id: SubscriptionId
    topic: Annotated[str, Field(min_length=1, max_length=200)]
    rate_hz: Annotated[float, Field(gt=0, le=1000)] | None = None
    since: Annotated[int, Field(ge=0, lt=2**53)] | None = None


class Unsubscribe(_ClientMessage):
    """No more of it."""

    op: Literal["unsub"]
    id: SubscriptionId


class Ack(_ClientMessage):
    """The frames up to this one are done with: another may come."""

    op: Literal["ack"]
    id: SubscriptionId
    seq: Annotated[int, Field(ge=0, lt=2**32)]


class Ping(_ClientMessage):
    """Answered with the same `t`."""

    op: Literal["ping"]
    t: float


ClientMessage = Hello | Subscribe | Unsubscribe | Ack | Ping
_CLIENT_MESSAGE: TypeAdapter[ClientMessage] = TypeAdapter(
    Annotated[ClientMessage, Field(discriminator="op")]
)


def parse_client_message(text: str) -> ClientMessage:
    """Reads what a client sent.

    Raises:
        ProtocolError: it is none of the messages, or a field is outside its range.
    """
    if len(text) > MAX_CLIENT_MESSAGE_BYTES:
        raise ProtocolError(f"{len(text)} characters, the limit is {MAX_CLIENT_MESSAGE_BYTES}")
    try:
        return _CLIENT_MESSAGE.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ProtocolError(f"{where}: {first['msg']}" if where else first["msg"]) from error


def welcome(server: str, now_unix_s: float) -> str:
    """The answer to hello; `server` is another one after a restart, and sequence numbers begin anew."""
    return _json(op="welcome", proto=VERSION, server=server, now_unix_s=now_unix_s)


def data(subscription: int, seq: int, t_unix_s: float, content: bytes) -> str:
    """A message of a topic.

    Args:
        t_unix_s: when the hub got it.
        content: JSON.
    """
    return _json(
        op="data", id=subscription, seq=seq, t_unix_s=t_unix_s, data=orjson.Fragment(content)
    )


def gap(subscription: int, missed: int | None) -> str:
    """So many messages of a topic will never come; None: nobody knows how many."""
    return _json(op="gap", id=subscription, missed=missed)


def error(subscription: int | None, title: str) -> str:
    """The client's last message, or that subscription, was refused."""
    return _json(op="error", id=subscription, title=title)


def pong(t: float, now_unix_s: float) -> str:
    """The answer to a ping, with the server's clock."""
    return _json(op="pong", t=t, now_unix_s=now_unix_s)


def _json(**fields: object) -> str:
    return orjson.dumps(fields).decode()


class LiveFrame(NamedTuple):
    """What stands before the pixels of a binary message.

    Attributes:
        seq: modulo 2**32.
        t_capture_unix_s: when the robot took it; `t_hub_unix_s`: when the hub sent it on.
        channels: of all stacked frames together, oldest first.
    """

    subscription: int
    seq: int
    t_capture_unix_s: float
    t_hub_unix_s: float
    channels: int
    height_px: int
    width_px: int
    frames_stacked: int
    form: int = FRAME_RAW

    def encode(self, pixels: bytes) -> bytes:
        """Header and pixels uint8[channels, height, width] as one message."""
        header = _FRAME_HEADER.pack(
            VERSION, self.form, self.subscription, self.seq, self.t_capture_unix_s, self.t_hub_unix_s,
            self.channels, self.height_px, self.width_px, self.frames_stacked,
        )  # fmt: skip
        return header + pixels

    @classmethod
    def decode(cls, message: bytes) -> tuple["LiveFrame", bytes]:
        """Reads `encode`'s bytes.

        Raises:
            ProtocolError: cut, of another version, or pixels that are not of its shape.
        """
        if len(message) < FRAME_HEADER_BYTES:
            raise ProtocolError(f"frame: {len(message)} bytes are less than a header")
        version, form, *fields = _FRAME_HEADER.unpack_from(message)
        frame, pixels = cls._make((*fields, form)), message[FRAME_HEADER_BYTES:]
        if version != VERSION or form not in (FRAME_RAW, FRAME_JPEG):
            raise ProtocolError(f"frame: version {version}, form {form}; this program reads 1")
        expected = frame.channels * frame.height_px * frame.width_px
        if form == FRAME_RAW and len(pixels) != expected:
            raise ProtocolError(f"frame: {len(pixels)} pixel bytes, its shape has {expected}")
        return frame, pixels
