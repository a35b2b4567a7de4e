"""An episode's form as bytes, of this schema and of older ones.

A msgpack map of schema, digest and content; the content is a msgpack map too, of the description and the arrays.
Older schemas had no digest, and the content's entries in its place.
"""

import hashlib
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

import msgpack
import numpy as np
from pydantic import Field, ValidationError

from bpn_shared.messages.base import Message, MessageError, check_size, unpack_map
from bpn_shared.messages.control import Count, Seed, WorkerId
from bpn_shared.spec.sections import MAX_STEPS

SCHEMA = 3
MAX_BYTES = 48 * 1024 * 1024


class EpisodeMeta(Message):
    """Which episode it is and where it comes from."""

    iteration: Count
    episode: Count
    seed: Seed
    slot: Count
    worker: WorkerId
    weights_attempt: Count
    weights_version: Count
    terminated: bool
    """The task ended it (a terminal state, good or bad), not the time limit."""
    success: bool | None = None
    """What the robot says of it, as an environment's `info["is_success"]`; None: it does not say."""
    deadline_misses: Count
    duration_ns: Annotated[int, Field(ge=0, lt=2**63)]
    """From the first frame's arrival to the last frame's."""


OutputsType = Literal["int32", "float32"]


class EpisodeParts(Message):
    """The content before it is arrays: T steps, pixels compressed, all numbers little-endian."""

    meta: EpisodeMeta
    steps: Annotated[int, Field(ge=1, le=MAX_STEPS)]
    frames: bytes
    actions: bytes
    rewards: bytes
    outputs_type: OutputsType
    outputs: bytes
    inference_ns: bytes
    camera_to_action_ns: bytes


def pack(parts: EpisodeParts) -> bytes:
    """The episode as bytes, in this schema."""
    content = msgpack.packb(parts.model_dump())
    packed: bytes = msgpack.packb(
        {"schema": SCHEMA, "sha256": hashlib.sha256(content).digest(), "content": content}
    )
    return packed


def unpack(data: bytes) -> EpisodeParts:
    """Reads bytes of any schema there has been.

    Raises:
        OtherVersionError: a schema that this program does not read.
        MessageError: oversized, malformed, or altered since it was packed.
    """
    check_size("episode", data, MAX_BYTES)
    schema, fields = unpack_map("episode", data, _READERS)
    try:
        return EpisodeParts.model_validate(_READERS[schema](fields))
    except ValidationError as error:
        first = error.errors()[0]
        raise MessageError(
            f"episode: {'.'.join(map(str, first['loc']))}: {first['msg']}"
        ) from error


_Fields = dict[str, Any]


def _verified(fields: _Fields) -> _Fields:
    """Schema 3: the content, if its digest is right."""
    digest, content = fields.get("sha256"), fields.get("content")
    if fields.keys() != {"sha256", "content"} or not isinstance(content, bytes):
        raise MessageError(f"episode: holds {', '.join(fields)}, not a digest and a content")
    if hashlib.sha256(content).digest() != digest:
        raise MessageError("episode: SHA-256 mismatch: it was altered since it was written")
    try:
        unpacked = msgpack.unpackb(content, raw=False, strict_map_key=True)
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"episode: its content is not msgpack: {error}") from error
    if not isinstance(unpacked, dict):
        raise MessageError("episode: its content is not a map")
    return unpacked


def _terminated(fields: _Fields) -> _Fields:
    """Schema 2: `terminated` was called `failed`, and nobody told of success."""
    meta = fields.get("meta")
    if not isinstance(meta, dict) or "failed" not in meta:
        raise MessageError("episode: meta says nothing of its end")
    others = {name: value for name, value in meta.items() if name != "failed"}
    return fields | {"meta": others | {"terminated": meta["failed"]}}


def _rewarded(fields: _Fields) -> _Fields:
    """Schema 1: from before robots told rewards and policies could be float."""
    steps = fields.get("steps")
    if not isinstance(steps, int) or not 1 <= steps <= MAX_STEPS:
        raise MessageError(f"episode: steps {steps!r} are outside 1..{MAX_STEPS}")
    rewards = np.full(steps, np.nan, "<f8").tobytes()
    return _terminated(fields | {"rewards": rewards, "outputs_type": "int32"})


_READERS: Mapping[int, Callable[[_Fields], _Fields]] = {
    1: _rewarded,
    2: _terminated,
    SCHEMA: _verified,
}
