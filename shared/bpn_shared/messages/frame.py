"""robot -> edge: one camera frame. The header rides in the attachment, the payload is the raw pixels."""

import math
import struct
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bpn_shared.messages.base import MessageError, OtherVersionError

SCHEMA = 4
_HEADER = struct.Struct("<BBBBIIIQQQIId")
HEADER_BYTES = _HEADER.size
_OLDER = struct.Struct("<BBBBBxxxIIIQQIId")
"""Schema 3: an action was a byte, and stood before the success."""
NO_ACTION = 2**64 - 1
_NO_ACTION_BYTE = 255
NO_SUCCESS = 255
NO_REWARD = math.nan


class FrameKind(IntEnum):
    FIRST = 0
    MID = 1
    LAST = 2
    """The episode's time is over (T steps)."""
    TERMINATED = 3
    """Last frame too: the task ended the episode (a terminal state, good or bad)."""

    @property
    def ends_episode(self) -> bool:
        return self >= FrameKind.LAST


_KINDS = tuple(FrameKind)


class FrameHeader(NamedTuple):
    """What identifies a frame, and what the robot did since the one before.

    Attributes:
        reset_id: names the reset that began this episode; frames of another one are not ours.
        step: t of this frame, 0..T.
        applied_action: the action that led here, its number; `NO_ACTION` in the first frame.
        t_capture_ns: the robot's monotonic clock when the frame was taken.
        camera_to_action_ns: from the capture of the frame before to the arrival of its action
            (0: none arrived in time), on the robot's clock; at most `LONGEST_NS`.
        deadline_misses: control periods so far in this episode that no action came for.
        reward: of the step that led here, where the robot knows it; `NO_REWARD` otherwise.
        success: what the robot says of the episode so far; None where it does not say.
    """

    kind: FrameKind
    iteration: int
    episode: int
    step: int
    reset_id: int
    t_capture_ns: int
    applied_action: int = NO_ACTION
    camera_to_action_ns: int = 0
    deadline_misses: int = 0
    channels: int = 1
    reward: float = NO_REWARD
    success: bool | None = None

    def encode(self) -> bytes:
        """The header as bytes."""
        success = NO_SUCCESS if self.success is None else self.success
        return _HEADER.pack(
            SCHEMA, self.kind, self.channels, success, self.iteration, self.episode, self.step,
            self.reset_id, self.applied_action, self.t_capture_ns, self.camera_to_action_ns,
            self.deadline_misses, self.reward,
        )  # fmt: skip

    @classmethod
    def decode(cls, data: bytes) -> "FrameHeader":
        """Reads `encode`'s bytes, and those of the schema before.

        Raises:
            OtherVersionError: a schema that this program does not read.
            MessageError: another size or kind, an infinite reward, or a success that is none.
        """
        schema = data[0] if data else SCHEMA
        if schema not in (SCHEMA - 1, SCHEMA):
            raise OtherVersionError(
                f"frame header: schema {schema}, this program reads {SCHEMA - 1} and {SCHEMA}"
            )
        form = _HEADER if schema == SCHEMA else _OLDER
        if len(data) != form.size:
            raise MessageError(f"frame header: {len(data)} bytes, expected {form.size}")
        numbers = form.unpack(data)
        if schema == SCHEMA:
            _, kind, channels, success, iteration, episode, step, reset_id, applied, *others = (
                numbers
            )
        else:
            _, kind, channels, applied, success, iteration, episode, step, reset_id, *others = (
                numbers
            )
            applied = NO_ACTION if applied == _NO_ACTION_BYTE else applied
        t_ns, loop_ns, misses, reward = others
        if kind >= len(_KINDS):
            raise MessageError(f"frame header: kind {kind} is none of 0..{len(_KINDS) - 1}")
        if math.isinf(reward):
            raise MessageError(f"frame header: reward {reward}")
        if success not in (False, True, NO_SUCCESS):
            raise MessageError(f"frame header: success {success} is none of 0, 1, {NO_SUCCESS}")
        return cls(
            _KINDS[kind], iteration, episode, step, reset_id, t_ns, applied, loop_ns, misses, channels,
            reward, None if success == NO_SUCCESS else bool(success),
        )  # fmt: skip


def decode_frame(
    attachment: bytes, payload: bytes, shape: tuple[int, int, int]
) -> tuple[FrameHeader, npt.NDArray[np.uint8]]:
    """A frame of the task's shape [c, rows, columns].

    Raises:
        MessageError: the header is malformed or the pixels are not of that shape.
    """
    header = FrameHeader.decode(attachment)
    expected = math.prod(shape)
    if header.channels != shape[0] or len(payload) != expected:
        raise MessageError(
            f"frame: {len(payload)} bytes with {header.channels} channels, the task's frames "
            f"{list(shape)} have {expected} bytes"
        )
    return header, np.frombuffer(payload, np.uint8).reshape(shape)
