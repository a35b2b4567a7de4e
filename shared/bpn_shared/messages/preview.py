"""robot -> whoever watches: what the network sees. The header rides in the attachment, the payload is pixels."""

import struct
from typing import NamedTuple

from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.spec.network import IMAGE_SIZE_PX

SCHEMA = 1
MAX_CHANNELS = 64
_HEADER = struct.Struct("<BBBxIIIQ")


class PreviewHeader(NamedTuple):
    """The header of an observation s_t, uint8[channels, 84, 84], oldest frame first.

    Attributes:
        channels: C of all stacked frames together.
        t_capture_unix_ns: when the newest of them was taken, on the clock of the robot's machine.
    """

    channels: int
    frames_stacked: int
    iteration: int
    episode: int
    step: int
    t_capture_unix_ns: int

    def encode(self) -> bytes:
        """The header as bytes."""
        return _HEADER.pack(SCHEMA, *self)

    @classmethod
    def decode(cls, data: bytes) -> "PreviewHeader":
        """Reads `encode`'s bytes.

        Raises:
            MessageError: another size or schema, or channels that are not that many frames.
        """
        if len(data) != _HEADER.size:
            raise MessageError(f"preview header: {len(data)} bytes, expected {_HEADER.size}")
        schema, *fields = _HEADER.unpack(data)
        if schema != SCHEMA:
            raise OtherVersionError(f"preview header: schema {schema}, this program reads {SCHEMA}")
        header = cls(*fields)
        stacked = header.frames_stacked
        if not 1 <= header.channels <= MAX_CHANNELS or not stacked or header.channels % stacked:
            raise MessageError(
                f"preview header: {header.channels} channels are no {stacked} stacked frames"
            )
        return header


def check_pixels(header: PreviewHeader, pixels: bytes) -> None:
    """Refuses pixels that are not of the header's shape.

    Raises:
        MessageError: another number of bytes.
    """
    expected = header.channels * IMAGE_SIZE_PX**2
    if len(pixels) != expected:
        raise MessageError(
            f"preview: {len(pixels)} bytes, {header.channels} channels have {expected}"
        )
