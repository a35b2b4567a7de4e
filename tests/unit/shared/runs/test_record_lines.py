"""The lines of metrics.jsonl and rewards.jsonl."""

import contextlib
import json
import logging
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from logged import lines

from bpn_shared.runs.digests import DamagedError, seal_line
from bpn_shared.runs.lines import RecordFile, read_line

GOLDEN = Path(__file__).parents[3] / "golden"
(FIRST,) = GOLDEN.glob("schema-1/*/metrics.jsonl")
OLD: dict[str, Any] = json.loads(FIRST.read_bytes().splitlines()[1])


def old(**changes: Any) -> bytes:
    return json.dumps(OLD | changes).encode()


DAMAGED = [
    b"{}",
    b"12",
    b"null",
    b"\x80\xff",
    b'{"a":' * 5000,
    b'{"iteration": 1, "retu',
    old(iteration="x"),
    old(iteration=-1),
    old(iteration=True),
    old(iteration=2**70),
    old(weights_version=2**70),
    old(length=[1]),
    old(loss=None),
    old(return_px=10**401),
    json.dumps({k: v for k, v in OLD.items() if k != "transitions"}).encode(),
    old().replace(b'"loss": 0', b'"loss": 1e999'),
    seal_line(OLD).replace(b'"episodes": 2', b'"episodes": 3'),
]


@pytest.mark.parametrize("line", DAMAGED)
def test_a_damaged_line_is_left_out_told_once_and_counted(
    line: bytes, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(b"\n".join([seal_line(OLD), line, old(iteration=2), b""]))
    file = RecordFile(path)
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            assert [record["iteration"] for record in file.read(sealed=False)] == [1, 2]
    assert file.damaged == 1
    (message,) = lines(caplog, RecordFile)
    assert "line 2 is damaged and left out" in message


@given(st.binary(max_size=80))
def test_any_bytes_are_a_record_or_damage(line: bytes) -> None:
    for sealed in (True, False):
        with contextlib.suppress(DamagedError):
            assert read_line(line, sealed=sealed)["iteration"] >= 0


def test_lines_of_every_schema_are_read_for_ever() -> None:
    records = RecordFile(FIRST).read(sealed=False)
    assert [record["iteration"] for record in records] == [0, 1, 2]
    assert records == RecordFile(GOLDEN / "metrics-2.jsonl").read(sealed=True)
    rewards = RecordFile(FIRST.with_name("rewards.jsonl")).read(sealed=False)
    assert [len(record["rewards_px"]) for record in rewards] == [2, 2, 2]
    assert rewards == RecordFile(GOLDEN / "rewards-2.jsonl").read(sealed=True)


def test_where_all_lines_have_a_digest_one_without_is_damaged() -> None:
    assert read_line(old(), sealed=False) == OLD
    with pytest.raises(DamagedError, match="lost its sha256"):
        read_line(old(), sealed=True)
    assert read_line(seal_line(OLD), sealed=True) == OLD


def test_lines_that_are_added_and_a_file_in_anothers_place_are_seen(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    file = RecordFile(path)
    assert file.read(sealed=True) == []
    path.write_bytes(seal_line({"iteration": 0, "a": 1}) + b"\n")
    assert file.read(sealed=True) == [{"iteration": 0, "a": 1}]
    with path.open("ab") as opened:
        opened.write(seal_line({"iteration": 0, "a": 2}) + b"\n")
    assert file.read(sealed=True) == [{"iteration": 0, "a": 2}]
    path.write_bytes(seal_line({"iteration": 5}) + b"\n")
    assert file.read(sealed=True) == [{"iteration": 5}]
