"""What a power cut leaves: nothing counts as written before it is on disk, contents first and then the name."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn_shared.runs.files import append_line, write_atomically


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """What goes to disk, in order: ("synced", a file's contents or "folder"), ("renamed", to what)."""
    events: list[tuple[str, str]] = []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        path = Path(f"/proc/self/fd/{descriptor}").resolve()
        events.append(("synced", "folder" if path.is_dir() else path.read_text()))
        fsync(descriptor)

    def renamed(source: str, target: str, **folders: int) -> None:
        events.append(("renamed", target))
        replace(source, target, **folders)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", renamed)
    return events


@pytest.mark.parametrize("before", [None, "old"])
def test_a_replaced_file_is_on_disk_before_it_has_its_name(
    before: str | None, told: list[tuple[str, str]], tmp_path: Path
) -> None:
    path = tmp_path / "state.json"
    if before is not None:
        path.write_text(before)
    write_atomically(path, b"new")
    assert told == [("synced", "new"), ("renamed", "state.json"), ("synced", "folder")]


def test_an_appended_line_is_on_disk_and_so_is_the_first_ones_file(
    told: list[tuple[str, str]], tmp_path: Path
) -> None:
    path = tmp_path / "metrics.jsonl"
    append_line(path, b"1")
    append_line(path, b"2")
    assert told == [("synced", "1\n"), ("synced", "folder"), ("synced", "1\n2\n")]


@pytest.mark.parametrize("write", [write_atomically, append_line])
def test_what_may_not_be_written_leaves_the_file_as_it_was(
    write: Callable[..., None], tmp_path: Path
) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(b"1\n")

    def refused() -> None:
        raise PermissionError("another owns it")

    with pytest.raises(PermissionError, match="another owns it"):
        write(path, b"2", prove=refused)
    assert path.read_bytes() == b"1\n"
    assert [p.name for p in tmp_path.iterdir()] == ["metrics.jsonl"]


def test_a_line_that_does_not_get_to_disk_is_not_half_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "metrics.jsonl"
    append_line(path, b"1")

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as raised:
        append_line(path, b"2")
    error = raised.value
    assert (error.errno, error.strerror, error.filename) == (
        errno.ENOSPC,
        "No space left on device",
        str(path),
    )
    assert path.read_bytes() == b"1\n"
