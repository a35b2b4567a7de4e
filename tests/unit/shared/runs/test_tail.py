import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_shared.runs.tail import Position, Tail, newest, read_on

LINES = st.lists(st.binary(min_size=1, max_size=12).filter(lambda line: b"\n" not in line))


def read_all(tail: Tail, limit: int) -> list[bytes]:
    lines: list[bytes] = []
    while (growth := tail.read(limit)).data:
        lines += growth.lines()
    return lines


@settings(max_examples=60)
@given(lines=LINES, cuts=st.lists(st.integers(1, 40), max_size=20), limit=st.integers(16, 64))
def test_however_a_file_grows_every_line_is_read_once_and_whole(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes], cuts: list[int], limit: int
) -> None:
    path = tmp_path_factory.mktemp("tail") / "file"
    data, tail, found = b"".join(line + b"\n" for line in lines), Tail(path), []
    with path.open("wb", buffering=0) as file:
        for cut in [*cuts, len(data)]:
            piece, data = data[:cut], data[cut:]
            file.write(piece)
            found += read_all(tail, limit)
            if tail.position is not None:  # it may rest anywhere meanwhile
                tail = Tail(path, Position(*tail.position))
    assert found == lines


def test_a_file_in_anothers_place_is_read_from_its_beginning(tmp_path: Path) -> None:
    path, tail = tmp_path / "file", Tail(tmp_path / "file")
    assert tail.read().data == b""  # there is none yet
    path.write_bytes(b"one\ntwo\n")
    assert (tail.read().data, tail.read().data) == (b"one\ntwo\n", b"")
    other = tmp_path / "other"
    other.write_bytes(b"another, and longer\n")
    os.replace(other, path)
    growth = tail.read()
    assert (growth.data, growth.is_new) == (b"another, and longer\n", True)
    assert not tail.read().is_new


@pytest.mark.parametrize("content", [b"a\n", b"", b"written anew in the same file, longer\nx\n"])
def test_a_file_that_was_cut_or_written_anew_is_read_from_its_beginning(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"one\ntwo\n")
    before = read_on(path, None)
    path.write_bytes(content)  # the same inode
    growth = read_on(path, before.position)
    assert (growth.is_new, growth.offset, growth.data) == (True, 0, content)


def test_a_line_that_is_too_long_is_handed_on_in_part_once_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 50)
    first = read_on(path, None, 10)
    assert first.data == b""
    with path.open("ab") as file:
        file.write(b"xx\nnext\n")
    second = read_on(path, first.position, 10)
    assert second.data == b"x" * 10 + b"\n"
    assert read_on(path, second.position, 10).data == b"next\n"


def test_a_link_a_pipe_and_a_folder_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"secret\n")
    (tmp_path / "link").symlink_to(tmp_path / "secret")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("link", "pipe", "folder"):
        with pytest.raises(OSError, match=name):
            read_on(tmp_path / name, None)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers())))
def test_the_later_record_of_an_iteration_counts(records: list[tuple[int, int]]) -> None:
    found = newest(records, lambda record: record[0])
    assert [iteration for iteration, _ in found] == sorted({i for i, _ in records})
    for iteration, value in found:
        assert value == [v for i, v in records if i == iteration][-1]
