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
    return [json.loads(entry) for entry in tail.new_entries()]


@given(
    st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\r\n")), max_size=20),
    st.lists(st.integers(0, 1500), max_size=5),
)
def test_however_it_is_written_every_line_comes_once(
    tmp_path_factory: Any, texts: list[str], cuts: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("logs")
    data = "".join(line(1, text) for text in texts).encode()
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
    for entry in seen:  # an id tells where the line is
        offset = int(entry["id"].removeprefix("edge-0:"))
        assert data[offset:].decode().split("\n")[0].endswith(entry["message"])
    assert len({entry["id"] for entry in seen}) == len(seen)


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
        ("edge-0", "ERROR", "broke\nTraceback\n  in f"),
        ("learner-0", "INFO", "last"),
    ]
    assert [e["time_unix_s"] is None for e in entries] == [False, False, False, False]


def test_a_traceback_that_comes_later_is_of_its_services_last_level(tmp_path: Path) -> None:
    path = tmp_path / "edge-0.log"
    path.write_text(line(3, "broke", level="ERROR"))
    tail = LogTail(tmp_path)
    read(tail)
    with path.open("a") as file:
        file.write("Traceback\n  in f\n")
    (entry,) = read(tail)
    assert (entry["level"], entry["message"]) == ("ERROR", "Traceback\n  in f")
    assert entry["time_unix_s"] is None


def test_a_long_file_begins_near_its_end_with_a_whole_line(tmp_path: Path) -> None:
    path = tmp_path / "edge-0.log"
    path.write_text("".join(line(1, f"{number:06d}") for number in range(50_000)))
    tail = LogTail(tmp_path)
    entries = read(tail)
    size = len(line(1, "000000"))
    assert entries[-1]["message"] == "049999"
    assert all(len(entry["message"]) == 6 for entry in entries)
    assert BACKLOG_BYTES - 2 * size < len(entries) * size <= BACKLOG_BYTES
    assert read(tail) == []


def test_new_and_restarted_files_are_followed_and_removed_ones_forgotten(tmp_path: Path) -> None:
    tail = LogTail(tmp_path)
    assert read(tail) == []
    path = tmp_path / "edge-0.log"
    path.write_text(line(1, "one") + line(1, "two"))
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
    assert read(tail) == []  # it may still be written
    with path.open("ab") as file:
        file.write(b"\n" + line(1, "next").encode())
    long, following = [entry for _ in range(3) for entry in read(tail)]
    assert len(long["message"]) == 10_000
    assert following["message"] == "next"
