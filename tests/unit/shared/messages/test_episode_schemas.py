"""Episodes of every schema that there has been stay readable; one that was altered never is."""

import hashlib
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS

from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.episode import Episode, EpisodeMeta, decode_meta
from bpn_shared.messages.episode_form import MAX_BYTES
from bpn_shared.spec.sections import MAX_STEPS

GOLDEN = Path(__file__).parents[3] / "golden" / "episodes"
REACHING = TASKS["reaching"]
NEWEST = (GOLDEN / "schema-3.bpne").read_bytes()


def golden(schema: int) -> Episode:
    """What every golden file holds, as far as its schema could say it."""
    t, y = np.ogrid[:4, :84]
    return Episode(
        meta=EpisodeMeta(
            iteration=4, episode=2, seed=2**63 + 5, slot=1, worker="edge-1a2b", weights_attempt=3,
            weights_version=4, terminated=True, success=False if schema > 2 else None,
            deadline_misses=1, duration_ns=435_000_000,
        ),
        frames=np.broadcast_to((t * 50 + y)[:, None, :, None], (4, 1, 84, 84)).astype(np.uint8),
        actions=np.array([0, 13, 7], np.uint8),
        rewards=np.array([-1.5, np.nan, 0.25]) if schema > 1 else np.full(3, np.nan),
        outputs=np.arange(-21, 21, dtype=np.int32).reshape(3, 14) * np.int32(100_000),
        inference_ns=np.array([5_000, 6_000, 2**32 - 1], np.uint32),
        camera_to_action_ns=np.array([260_000, 0, 270_000], np.uint32),
    )  # fmt: skip


@pytest.mark.parametrize("schema", [1, 2, 3])
def test_every_schema_is_read_for_ever(schema: int) -> None:
    data = (GOLDEN / f"schema-{schema}.bpne").read_bytes()
    found, expected = Episode.decode(data, REACHING), golden(schema)
    assert msgpack.unpackb(data)["schema"] == schema
    assert (found.meta, 3) == (expected.meta, expected.steps) == decode_meta(data)
    for name in ("frames", "actions", "rewards", "outputs", "inference_ns", "camera_to_action_ns"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert getattr(found, name).dtype == getattr(expected, name).dtype


def test_what_is_written_today_is_the_newest_schema() -> None:
    assert golden(3).encode() == NEWEST


@given(st.integers(0, 8 * len(NEWEST) - 1))
def test_any_flipped_bit_is_noticed(bit: int) -> None:
    damaged = bytearray(NEWEST)
    damaged[bit // 8] ^= 1 << bit % 8
    with pytest.raises(MessageError):
        decode_meta(bytes(damaged))
    with pytest.raises(MessageError):
        Episode.decode(bytes(damaged), REACHING)


@given(st.integers(0, len(NEWEST) - 1))
def test_a_truncated_episode_is_noticed(length: int) -> None:
    with pytest.raises(MessageError):
        decode_meta(NEWEST[:length])


def test_a_newer_schema_is_another_version_and_not_damage() -> None:
    newer = msgpack.packb(msgpack.unpackb(NEWEST) | {"schema": 4})
    with pytest.raises(OtherVersionError, match=r"schema 4, this program \(bpn .*\) reads 1, 2, 3"):
        Episode.decode(newer, REACHING)
    with pytest.raises(MessageError) as damage:
        decode_meta(NEWEST[:-1])
    assert not isinstance(damage.value, OtherVersionError)


@pytest.mark.parametrize("schema", [1, 2])
def test_an_older_one_without_its_fields_is_refused(schema: int) -> None:
    fields = msgpack.unpackb((GOLDEN / f"schema-{schema}.bpne").read_bytes())
    for name in fields.keys() - {"schema"}:
        fewer = {key: value for key, value in fields.items() if key != name}
        with pytest.raises(MessageError, match=name):
            decode_meta(msgpack.packb(fewer))


def test_no_more_is_read_than_an_episode_may_have() -> None:
    assert MAX_BYTES == 48 * 2**20
    with pytest.raises(MessageError, match=rf"{MAX_BYTES + 1} bytes, the limit is {MAX_BYTES}"):
        decode_meta(NEWEST + bytes(MAX_BYTES + 1 - len(NEWEST)))


@pytest.mark.parametrize(
    "changes",
    [{"content": None}, {"content": 3}, {"content": "text"}, {"sha256": None}, {"more": 1}],
)
def test_the_newest_is_a_digest_and_a_content_and_nothing_else(changes: dict[str, object]) -> None:
    told = msgpack.unpackb(NEWEST) | changes
    fields = {name: value for name, value in told.items() if value is not None}
    with pytest.raises(MessageError, match="not a digest and a content"):
        decode_meta(msgpack.packb(fields))


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b"\xc1", "its content is not msgpack"), (msgpack.packb([1]), "its content is not a map")],
)
def test_a_content_that_is_none_is_refused_although_its_digest_is_right(
    content: bytes, reason: str
) -> None:
    digest = hashlib.sha256(content).digest()
    data = msgpack.packb({"schema": 3, "sha256": digest, "content": content})
    with pytest.raises(MessageError, match=reason):
        decode_meta(data)


@pytest.mark.parametrize("steps", [0, MAX_STEPS + 1, -1, "3", None])
def test_the_oldest_has_as_many_steps_as_an_episode_may_have(steps: object) -> None:
    fields = msgpack.unpackb((GOLDEN / "schema-1.bpne").read_bytes())
    with pytest.raises(MessageError, match=rf"steps {steps!r} are outside 1\.\.{MAX_STEPS}"):
        decode_meta(msgpack.packb(fields | {"steps": steps}))


@pytest.mark.parametrize("schema", [1, 2])
@pytest.mark.parametrize("meta", [None, 3, {}])
def test_an_older_one_that_says_nothing_of_its_end_is_refused(schema: int, meta: object) -> None:
    fields = msgpack.unpackb((GOLDEN / f"schema-{schema}.bpne").read_bytes())
    with pytest.raises(MessageError, match="meta says nothing of its end"):
        decode_meta(msgpack.packb(fields | {"meta": meta}))


def test_the_end_of_an_older_one_is_read() -> None:
    fields = msgpack.unpackb((GOLDEN / "schema-2.bpne").read_bytes())
    for failed in (False, True):
        changed = fields | {"meta": fields["meta"] | {"failed": failed}}
        meta, _ = decode_meta(msgpack.packb(changed))
        assert (meta.terminated, meta.success) == (failed, None)
