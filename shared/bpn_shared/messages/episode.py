"""edge -> learner: one finished episode; the same bytes rest in the run folder (`episode_form`).

Pixels are compressed (zlib): simulated images shrink about twentyfold, and the bytes are stored as they came.
"""

import math
import zlib
from dataclasses import dataclass
from typing import Any, Self, cast

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.outputs import Outputs
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.episode_form import (
    MAX_BYTES,
    EpisodeMeta,
    EpisodeParts,
    OutputsType,
    pack,
    unpack,
)
from bpn_shared.spec.tasks import TaskSpec

__all__ = ["MAX_BYTES", "Episode", "EpisodeMeta", "decode_meta"]


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode of T steps.

    Attributes:
        frames: uint8[T+1, c, rows, columns], each stored once.
        actions: uint8[T], as the robot applied them; of several dimensions uint8[T, D], the choice in each.
        rewards: float64[T] as the robot knows them; NaN where it knows none, as a real one does. The paper's
            tasks are learned from the pixels alone.
        outputs: [T, |A|], what the network said to every step's observation; int32 or float32. Of an action of
            several dimensions one number for each choice, the dimensions' side by side.
        inference_ns: uint32[T], time in the kernel.
        camera_to_action_ns: uint32[T], on the robot's clock; 0 where no action came in time.
    """

    meta: EpisodeMeta
    frames: npt.NDArray[np.uint8]
    actions: npt.NDArray[np.uint8]
    rewards: npt.NDArray[np.float64]
    outputs: Outputs
    inference_ns: npt.NDArray[np.uint32]
    camera_to_action_ns: npt.NDArray[np.uint32]

    @property
    def steps(self) -> int:
        """T."""
        return len(self.actions)

    def encode(self) -> bytes:
        """The episode as bytes."""
        return pack(
            EpisodeParts(
                meta=self.meta,
                steps=self.steps,
                frames=zlib.compress(self.frames.tobytes(), level=1),
                actions=self.actions.tobytes(),
                rewards=self.rewards.astype("<f8").tobytes(),
                outputs_type=cast(OutputsType, self.outputs.dtype.name),
                outputs=self.outputs.astype(self.outputs.dtype.newbyteorder("<")).tobytes(),
                inference_ns=self.inference_ns.astype("<u4").tobytes(),
                camera_to_action_ns=self.camera_to_action_ns.astype("<u4").tobytes(),
            )
        )

    @classmethod
    def decode(cls, data: bytes, task: TaskSpec) -> Self:
        """Reads `encode`'s bytes, of this schema or an older one, for a task's shapes.

        Raises:
            OtherVersionError: a schema that this program does not read.
            MessageError: oversized, malformed, altered, or arrays that do not fit the task or each other.
        """
        parts = unpack(data)
        steps = parts.steps
        shape = (steps,) if len(task.dims) == 1 else (steps, len(task.dims))
        actions = _array("actions", parts.actions, np.uint8, shape)
        _check_actions(actions, task)
        return cls(
            meta=parts.meta,
            frames=_inflate(parts.frames, (steps + 1, *task.frame_shape)),
            actions=actions,
            rewards=_array("rewards", parts.rewards, np.float64, (steps,)),
            outputs=_array(
                "outputs", parts.outputs, _OUTPUT_TYPES[parts.outputs_type], (steps, task.actions)
            ),
            inference_ns=_array("inference_ns", parts.inference_ns, np.uint32, (steps,)),
            camera_to_action_ns=_array(
                "camera_to_action_ns", parts.camera_to_action_ns, np.uint32, (steps,)
            ),
        )


_OUTPUT_TYPES: dict[str, type[np.int32 | np.float32]] = {"int32": np.int32, "float32": np.float32}


def decode_meta(data: bytes) -> tuple[EpisodeMeta, int]:
    """Of an episode's bytes only what it is and its number of steps T; no pixels are inflated.

    Raises:
        OtherVersionError: a schema that this program does not read.
        MessageError: oversized, malformed or altered.
    """
    parts = unpack(data)
    return parts.meta, parts.steps


def _check_actions(actions: npt.NDArray[np.uint8], task: TaskSpec) -> None:
    for d, (most, choices) in enumerate(
        zip(actions.reshape(len(actions), -1).max(axis=0).tolist(), task.dims, strict=True)
    ):
        if most >= choices:
            where = f" of dimension {d}" if len(task.dims) > 1 else ""
            raise MessageError(f"episode: action {most}{where} is outside 0..{choices - 1}")


def _array(
    name: str, data: bytes, dtype: type[np.generic], shape: tuple[int, ...]
) -> npt.NDArray[Any]:
    expected = math.prod(shape) * np.dtype(dtype).itemsize
    if len(data) != expected:
        raise MessageError(f"episode: {name}: {len(data)} bytes, {list(shape)} has {expected}")
    return np.frombuffer(data, np.dtype(dtype).newbyteorder("<")).reshape(shape)


def _inflate(data: bytes, shape: tuple[int, ...]) -> npt.NDArray[np.uint8]:
    expected = math.prod(shape)
    inflater = zlib.decompressobj()
    try:
        raw = inflater.decompress(data, expected + 1)  # bounded: a bomb cannot grow past this
    except zlib.error as error:
        raise MessageError(f"episode: frames: {error}") from error
    if not inflater.eof or inflater.unused_data:
        raise MessageError(f"episode: frames: not the {expected} bytes of {list(shape)}")
    return _array("frames", raw, np.uint8, shape)
