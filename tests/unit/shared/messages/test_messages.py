import hashlib
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paper import TASKS

from bpn_shared.messages.action import Action
from bpn_shared.messages.base import MAX_CONTROL_BYTES, MessageError, OtherVersionError
from bpn_shared.messages.control import Assignment, EpisodeReceipt, NextEpisode, Reset, ResetReply
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.messages.frame import FrameHeader, FrameKind, decode_frame
from bpn_shared.messages.metrics import MetricsBatch, Point
from bpn_shared.messages.preview import PreviewHeader, check_pixels
from bpn_shared.messages.telemetry import (
    CertificateLife,
    KeyTraffic,
    Percentiles,
    Telemetry,
    WeightsMark,
)

REACHING = TASKS["reaching"]
u32, u64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
headers = st.builds(
    FrameHeader, st.sampled_from(FrameKind), u32, u32, u32, u64, u64, st.integers(0, 255), u32, u32,
    st.just(1), st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([None, False, True]),
)  # fmt: skip
previews = st.builds(
    lambda channels, stacked, *rest: PreviewHeader(channels * stacked, stacked, *rest),
    st.integers(1, 4), st.integers(1, 16), u32, u32, u32, u64, st.integers(8, 128),
)  # fmt: skip
actions = st.builds(Action, st.integers(0, 13), u32, u32, u64, u32, u32)


def make_episode(steps: int = 3, seed: int = 0, **changes: Any) -> Episode:
    rng = np.random.default_rng(seed)
    meta = EpisodeMeta(
        iteration=0, episode=0, seed=1, slot=0, worker="edge-0", weights_attempt=1,
        weights_version=0, terminated=False, deadline_misses=0, duration_ns=1,
    )  # fmt: skip
    return Episode(
        meta=meta.model_copy(update=changes),
        frames=rng.integers(0, 256, (steps + 1, *REACHING.frame_shape), dtype=np.uint8),
        actions=rng.integers(0, REACHING.actions, steps, dtype=np.uint8),
        rewards=rng.normal(size=steps),
        outputs=rng.integers(-100, 100, (steps, REACHING.actions), dtype=np.int32),
        inference_ns=rng.integers(0, 10**6, steps, dtype=np.uint32),
        camera_to_action_ns=rng.integers(0, 10**6, steps, dtype=np.uint32),
    )


EPISODE = make_episode()
MESSAGES = [
    Reset(iteration=1, episode=2, seed=3, reset_id=4),
    ResetReply(reset_id=2**64 - 1),
    NextEpisode(slot=0, worker="edge-1a"),
    NextEpisode(slot=0, worker="edge-1a", weights_version=7),
    Assignment(status="play", iteration=1, episode=2, seed=3, weights_version=1),
    EpisodeReceipt(status="refused", reason="no"),
    MetricsBatch(points=[Point(name="loss", step=1, value=0.5, time_ns=1)]),
    Decision(
        iteration=1, episode=2, step=3, action=4, outputs=[-5, 2**31 - 1], scale=0.25,
        weights_version=1, inference_ns=5000, edge_ns=90_000, time_ns=2**63,
    ),
    Telemetry(
        kind="edge", worker="edge-1", run="0198c0de-0000-7000-8000-000000000001", slot=3, host="cell",
        clock="boot", pid=7, time_ns=1, uptime_s=0.5, waiting_for="a frame", waiting_s=0.25,
        cpu_percent=3.5, rss_bytes=2**30, counters={"frames_refused": 1},
        weights={"loaded": WeightsMark(attempt=1, version=2, time_ns=3)},
        latencies={"edge_us": Percentiles(count=1, p50_us=-1.5, p95_us=2.0, p99_us=2.0, max_us=9.0)},
        traffic=[KeyTraffic(key="a/b", direction="sent", messages=1, bytes=2, dropped=0)],
        certificate=CertificateLife(start_unix_s=1.0, end_unix_s=2.5),
    ),
]  # fmt: skip
DECODERS: list[tuple[bytes, Callable[[bytes], object]]] = [
    *((message.encode(), type(message).decode) for message in MESSAGES),
    (EPISODE.encode(), lambda data: Episode.decode(data, REACHING)),
    (FrameHeader(FrameKind.MID, 1, 2, 3, 4, 5).encode(), FrameHeader.decode),
    (Action(1, 2, 3, 4, 5, 6).encode(), lambda data: Action.decode(data, 14)),
    (PreviewHeader(6, 2, 3, 4, 5, 6).encode(), PreviewHeader.decode),
]


@given(headers, actions, previews)
def test_structs_survive_the_wire(
    header: FrameHeader, action: Action, preview: PreviewHeader
) -> None:
    assert PreviewHeader.decode(preview.encode()) == preview
    assert FrameHeader.decode(header.encode()) == header
    assert Action.decode(action.encode(), 14) == action


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_maps_survive_the_wire(message: Any) -> None:
    assert type(message).decode(message.encode()) == message


ARRAYS = ("frames", "actions", "rewards", "outputs", "inference_ns", "camera_to_action_ns")


@given(st.integers(1, 8), st.integers(0, 2**32), st.sampled_from([np.int32, np.float32]))
def test_episodes_survive_the_wire(steps: int, seed: int, outputs: type) -> None:
    episode = make_episode(steps, seed)
    episode = replace(episode, outputs=episode.outputs.astype(outputs))
    episode.rewards[0] = np.nan  # the robot knows none
    decoded = Episode.decode(episode.encode(), REACHING)
    assert decoded.meta == episode.meta
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(decoded, name), getattr(episode, name))
        assert getattr(decoded, name).dtype == getattr(episode, name).dtype


def test_a_frame_may_tell_of_no_reward_but_of_no_infinite_one() -> None:
    header = FrameHeader(FrameKind.MID, 1, 2, 3, 4, 5)
    assert np.isnan(FrameHeader.decode(header.encode()).reward)
    with pytest.raises(MessageError, match="reward -inf"):
        FrameHeader.decode(header._replace(reward=-np.inf).encode())


def test_an_older_frame_is_refused_by_its_schema() -> None:
    header = FrameHeader(FrameKind.MID, 1, 2, 3, 4, 5).encode()
    with pytest.raises(OtherVersionError, match="frame header: schema 2, this program reads 3"):
        FrameHeader.decode(b"\x02" + header[1:])


@given(st.sampled_from(FrameKind))
def test_only_the_last_two_kinds_of_frame_end_an_episode(kind: FrameKind) -> None:
    assert kind.ends_episode == (kind.name in ("LAST", "TERMINATED"))
    assert FrameHeader.decode(FrameHeader(kind, 1, 2, 3, 4, 5).encode()).kind is kind


def resealed(**changes: Any) -> bytes:
    """The episode with other content under a digest that is right."""
    content = msgpack.packb(msgpack.unpackb(msgpack.unpackb(EPISODE.encode())["content"]) | changes)
    return msgpack.packb(
        {"schema": 3, "sha256": hashlib.sha256(content).digest(), "content": content}
    )


def test_outputs_of_another_type_are_refused() -> None:
    with pytest.raises(MessageError, match="outputs_type"):
        Episode.decode(resealed(outputs_type="float64"), REACHING)


def test_pixels_that_do_not_inflate_are_refused() -> None:
    frames = bytearray(zlib.compress(EPISODE.frames.tobytes()))
    frames[len(frames) // 2] ^= 0xFF
    with pytest.raises(MessageError, match="episode: frames: Error -3"):
        Episode.decode(resealed(frames=bytes(frames)), REACHING)
    with pytest.raises(MessageError, match="episode: frames: not the 28224 bytes"):
        Episode.decode(resealed(frames=bytes(frames[:100])), REACHING)


@settings(max_examples=300)
@given(st.sampled_from(DECODERS), st.data())
def test_no_damage_does_more_than_raise_message_error(
    encoded_and_decoder: tuple[bytes, Callable[[bytes], object]], data: st.DataObject
) -> None:
    encoded, decode = encoded_and_decoder
    kind = data.draw(st.sampled_from(["truncate", "extend", "flip", "noise"]))
    damaged = bytearray(encoded)
    if kind == "truncate":
        damaged = damaged[: data.draw(st.integers(0, len(encoded) - 1))]
    elif kind == "extend":
        damaged += data.draw(st.binary(min_size=1, max_size=32))
    elif kind == "noise":
        damaged = bytearray(data.draw(st.binary(max_size=512)))
    else:
        position = data.draw(st.integers(0, len(encoded) - 1))
        damaged[position] ^= data.draw(st.integers(1, 255))
    try:
        decode(bytes(damaged))
    except MessageError:
        return
    # a changed value may still be a valid message; a changed length never is
    assert kind in ("flip", "noise")


@given(st.binary(max_size=100))
def test_a_frame_of_another_size_is_refused(extra: bytes) -> None:
    header = FrameHeader(FrameKind.MID, 0, 0, 0, 0, 0).encode()
    with pytest.raises(MessageError, match=r"the task's frames \[1, 84, 84\] have 7056 bytes"):
        decode_frame(header, bytes(7057) + extra, REACHING.frame_shape)


def test_a_preview_must_be_whole_frames_of_its_shape() -> None:
    with pytest.raises(MessageError, match="5 channels are no 2 stacked frames"):
        PreviewHeader.decode(PreviewHeader(5, 2, 0, 0, 0, 0).encode())
    header = PreviewHeader(2, 2, 0, 0, 0, 0)
    check_pixels(header, bytes(2 * 84 * 84))
    with pytest.raises(MessageError, match="2 channels have 14112"):
        check_pixels(header, bytes(84 * 84))
    smaller = header._replace(frame_px=32)
    check_pixels(smaller, bytes(2 * 32 * 32))
    with pytest.raises(MessageError, match="2 channels have 2048"):
        check_pixels(smaller, bytes(2 * 84 * 84))


def test_a_preview_of_before_there_were_other_sizes_has_frames_of_84_pixels() -> None:
    """The place of the size was empty then."""
    older = bytearray(PreviewHeader(2, 2, 3, 4, 5, 6).encode())
    assert older[3] == 84
    older[3] = 0
    assert PreviewHeader.decode(bytes(older)) == PreviewHeader(2, 2, 3, 4, 5, 6)
    for impossible in (7, 129):
        older[3] = impossible
        with pytest.raises(MessageError, match=f"frames of {impossible} x {impossible} pixels"):
            PreviewHeader.decode(bytes(older))


def test_an_action_that_the_task_does_not_have_is_refused() -> None:
    with pytest.raises(MessageError, match=r"14 is outside 0\.\.13"):
        Action.decode(Action(14, 0, 0, 0, 0, 0).encode(), 14)


def test_another_schema_is_refused_by_name() -> None:
    newer = msgpack.packb({**msgpack.unpackb(MESSAGES[0].encode()), "schema": 2})
    with pytest.raises(
        MessageError, match=r"schema 2, this program \(bpn .*\) reads 1: install the same version"
    ):
        Reset.decode(newer)


def test_unknown_and_out_of_range_fields_are_refused_by_name() -> None:
    fields = msgpack.unpackb(MESSAGES[0].encode())
    with pytest.raises(MessageError, match="colour"):
        Reset.decode(msgpack.packb({**fields, "colour": 1}))
    with pytest.raises(MessageError, match="iteration"):
        Reset.decode(msgpack.packb({**fields, "iteration": -1}))


def test_oversized_input_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(MessageError, match="the limit is"):
        Reset.decode(bytes(MAX_CONTROL_BYTES + 1))


def test_a_decompression_bomb_is_refused_without_inflating_it() -> None:
    bomb = zlib.compress(bytes(200 * 1024 * 1024), level=9)  # 200 MB in 200 KB
    with pytest.raises(MessageError, match="not the 28224 bytes"):
        Episode.decode(resealed(frames=bomb), REACHING)


def test_an_episode_whose_arrays_do_not_fit_is_refused() -> None:
    short = replace(EPISODE, actions=EPISODE.actions[:-1])
    with pytest.raises(MessageError, match="frames"):
        Episode.decode(short.encode(), REACHING)
    wild = replace(EPISODE, actions=np.full(3, 14, np.uint8))
    with pytest.raises(MessageError, match=r"action 14 is outside 0\.\.13"):
        Episode.decode(wild.encode(), REACHING)
