"""robot -> whoever watches: what the network sees. The header rides in the attachment, the payload is pixels."""

import struct
from typing import NamedTuple

from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.spec.network import IMAGE_SIZE_PX, MAX_IMAGE_SIZE_PX, MIN_IMAGE_SIZE_PX

SCHEMA = 1
MAX_CHANNELS = 64
_HEADER = struct.Struct("<BBBBIIIQ")


class PreviewHeader(NamedTuple):
    """The header of an observation s_t, uint8[channels, frame_px, frame_px], oldest frame first.

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
    frame_px: int = IMAGE_SIZE_PX

    def encode(self) -> bytes:
        """The header as bytes; older programs left the place of `frame_px` empty, and pass over it."""
        *others, frame_px = self
        channels, stacked, *rest = others
        return _HEADER.pack(SCHEMA, channels, stacked, frame_px, *rest)

    @classmethod
    def decode(cls, data: bytes) -> "PreviewHeader":
        """Reads `encode`'s bytes.

        Raises:
            MessageError: another size or schema, or channels that are not that many frames.
        """
        if len(data) != _HEADER.size:
            raise MessageError(f"preview header: {len(data)} bytes, expected {_HEADER.size}")
        schema, channels, stacked, frame_px, *rest = _HEADER.unpack(data)
        if schema != SCHEMA:
            raise OtherVersionError(f"preview header: schema {schema}, this program reads {SCHEMA}")
        header = cls._make((channels, stacked, *rest, frame_px or IMAGE_SIZE_PX))
        if not MIN_IMAGE_SIZE_PX <= header.frame_px <= MAX_IMAGE_SIZE_PX:
            raise MessageError(f"preview header: frames of {frame_px} x {frame_px} pixels")
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
    expected = header.channels * header.frame_px**2
    if len(pixels) != expected:
        raise MessageError(
            f"preview: {len(pixels)} bytes, {header.channels} channels have {expected}"
        )
