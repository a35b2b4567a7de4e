from pathlib import Path

import pytest

from bpn_shared.runs.digests import seal
from bpn_shared.runs.state import RunState, decode_state, encode_state
from bpn_shared.spec.config import ConfigError

GOLDEN = Path(__file__).parents[3] / "golden"
STATE = RunState(
    state="failed", attempt=3, created_unix_s=1.5, updated_unix_s=2.5, error="x", owner="learner-1"
)


def test_it_is_read_as_it_was_written() -> None:
    assert decode_state(encode_state(STATE), source="") == STATE


def test_every_schema_is_read_for_ever() -> None:
    (first,) = GOLDEN.glob("schema-1/*/state.json")
    assert decode_state(first.read_bytes(), source="") == RunState(
        state="stopped",
        attempt=1,
        created_unix_s=1795802483.23021,
        updated_unix_s=1795802486.8267767,
    )
    assert decode_state((GOLDEN / "state-2.json").read_bytes(), source="") == STATE


@pytest.mark.parametrize(("data", "reason"), [
    (encode_state(STATE).replace(b"3", b"4"), "changed after it was written"),
    (encode_state(STATE).replace(b'"sha256"', b'"sha255"'), "lost its sha256"),
    (seal({"schema": 3, "mood": "good"}), "schema 3, .*use the version that wrote it"),
    (b'{"state": "asleep"}', "state: Input should be"),
    (b'{"attempt": -1}', "attempt: Input should be greater"),
    (b"", "no JSON"),
    (b"\xff" * 9, "no JSON"),
])  # fmt: skip
def test_damage_is_one_line_with_the_remedy(data: bytes, reason: str) -> None:
    with pytest.raises(ConfigError, match=rf"^runs/state\.json: .*{reason}") as raised:
        decode_state(data, source="runs/state.json")
    assert "\n" not in str(raised.value)
