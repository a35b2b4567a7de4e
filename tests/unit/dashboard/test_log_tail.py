import json
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.hub.log_tail import BACKLOG_BYTES, LogTail

PREFIX = "2026-11-22T08:22:{second:02d}.000Z"


def line(second: int, text: str, service: str = "edge-0", level: str = "INFO") -> str:
    return f"{PREFIX.format(second=second)} {service} {level} {text}\n"


def read(tail: LogTail) -> list[dict[str, Any]]:
    return [json.loads(entry) for entry in tail.new_lines()]


@given(
    st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\r\n")), max_size=20),
    st.lists(st.integers(0, 500), max_size=5),
)
def test_however_it_is_written_every_line_comes_once(
    tmp_path_factory: Any, texts: list[str], cuts: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("logs")
    data = "".join(f"{text}\n" for text in texts).encode()
    path, tail = folder / "edge-0.log", LogTail(folder)
    path.touch()
    seen = read(tail)
    written = 0
    for cut in [*sorted(cuts), len(data)]:
        with path.open("ab") as file:
            file.write(data[written:cut])
        written = max(written, min(cut, len(data)))
        seen += read(tail)
    assert [entry["message"] for entry in seen] == texts
    ids = [entry["id"] for entry in seen]
    assert len(set(ids)) == len(ids)
    for entry in seen:  # an id tells where the line is
        offset = int(entry["id"].removeprefix("edge-0:"))
        assert data[offset:].decode().split("\n")[0] == entry["message"]


def test_lines_of_several_services_come_by_time_and_tracebacks_stay_with_theirs(
    tmp_path: Path,
) -> None:
    (tmp_path / "edge-0.log").write_text(
        line(1, "first") + line(3, "broke", level="ERROR") + "Traceback\n  in f\n"
    )
    (tmp_path / "learner.log").write_text(
        line(2, "second", "learner-0") + line(4, "last", "learner-0")
    )
    (tmp_path / "notes.txt").write_text("no log\n")
    entries = read(LogTail(tmp_path))
    assert [(e["service"], e["level"], e["message"]) for e in entries] == [
        ("edge-0", "INFO", "first"),
        ("learner-0", "INFO", "second"),
        ("edge-0", "ERROR", "broke"),
        ("edge-0", "ERROR", "Traceback"),
        ("edge-0", "ERROR", "  in f"),
        ("learner-0", "INFO", "last"),
    ]
    assert [e["time_unix_s"] is None for e in entries] == [False, False, False, True, True, False]


def test_a_long_file_begins_near_its_end_with_a_whole_line(tmp_path: Path) -> None:
    path = tmp_path / "edge-0.log"
    path.write_text("".join(f"line {number:06d}\n" for number in range(50_000)))
    tail = LogTail(tmp_path)
    entries = read(tail)
    assert entries[-1]["message"] == "line 049999"
    assert all(len(entry["message"]) == len("line 000000") for entry in entries)
    assert BACKLOG_BYTES - 20 < len(entries) * 12 <= BACKLOG_BYTES
    assert read(tail) == []


def test_new_and_restarted_files_are_followed_and_removed_ones_forgotten(tmp_path: Path) -> None:
    tail = LogTail(tmp_path)
    assert read(tail) == []
    path = tmp_path / "edge-0.log"
    path.write_text("one\ntwo\n")
    assert [entry["message"] for entry in read(tail)] == ["one", "two"]
    path.write_text("new\n")
    assert [entry["message"] for entry in read(tail)] == ["new"]
    path.unlink()
    assert read(tail) == []


def test_a_line_without_end_does_not_fill_the_memory(tmp_path: Path) -> None:
    path = tmp_path / "edge-0.log"
    path.touch()
    tail = LogTail(tmp_path)
    read(tail)
    path.write_bytes(b"x" * 1_000_000)
    entries = [entry for _ in range(10) for entry in read(tail)]
    assert 1 <= len(entries) <= 10
    assert max(len(entry["message"]) for entry in entries) <= 10_000
