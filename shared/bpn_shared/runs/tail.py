"""Follows files that grow by whole lines: metrics, rewards, logs.

A reader keeps a `Position`, which may rest in a database, and asks for what came after it. A file that was
replaced, cut or written anew is read from its beginning, and the reader is told to forget what it knew of it.
"""

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

from bpn_shared.runs.opening import open_file

READ_BYTES = 4 * 1024 * 1024
_INODES = 2**63  # databases have no unsigned integers

Record = TypeVar("Record")


class Position(NamedTuple):
    """How far a file was read."""

    inode: int
    offset: int
    """Bytes, up to the end of a line."""


class Growth(NamedTuple):
    """What a file has after a position."""

    data: bytes
    """Whole lines, each with its newline."""
    position: Position | None
    """Up to where they go: the next position to read from. None: there is no file and never was."""
    is_new: bool
    """It is another file than was read before: what is known of that one no longer counts."""
    offset: int
    """Bytes, where `data` begins in the file."""

    def lines(self) -> list[bytes]:
        """The lines without their newlines; empty ones are none."""
        return [line for line in self.data.split(b"\n") if line]


def read_on(
    path: Path, position: Position | None, limit: int = READ_BYTES, *, root: Path | None = None
) -> Growth:
    """The whole lines after a position, or from the beginning of a file that is another one.

    A last line without its newline is still being written, and left for the next time. Of a line of more than
    `limit` bytes the first `limit` are handed on as if it were that long.

    Args:
        position: where the last `read_on` ended; None: at the beginning.
        limit: bytes to read at once; as long as `data` is not empty there may be more.
        root: a directory above the file, between which and the file no link is followed either; its own
            directory if there is none.

    Raises:
        OSError: what stands there cannot be read, or is no regular file (links are not followed).
    """
    root = root or path.parent
    try:
        opened = open_file(root, path.relative_to(root))
    except FileNotFoundError:
        return Growth(b"", position, is_new=False, offset=position.offset if position else 0)
    with opened as file:
        status = os.fstat(file.fileno())
        inode = status.st_ino % _INODES
        is_new = position is not None and not _goes_on(file, position, inode, status.st_size)
        begin = 0 if position is None or is_new else position.offset
        file.seek(begin)
        data = file.read(limit)
        end = data.rfind(b"\n") + 1
        if end == 0 and len(data) == limit:
            end = _line_end(file)  # of a line that is too long to be one
            data = data + b"\n" if end else b""
            return Growth(data, Position(inode, end or begin), is_new, begin)
        return Growth(data[:end], Position(inode, begin + end), is_new, begin)


def near_end(path: Path, backlog: int, *, root: Path | None = None) -> Position | None:
    """Where to begin for the last whole lines of a file, at most `backlog` bytes of them; None: at its beginning.

    Raises:
        OSError: as `read_on`.
    """
    root = root or path.parent
    try:
        opened = open_file(root, path.relative_to(root))
    except FileNotFoundError:
        return None
    with opened as file:
        status = os.fstat(file.fileno())
        if status.st_size <= backlog:
            return None
        file.seek(status.st_size - backlog - 1)
        skipped = file.readline(backlog)
        if not skipped.endswith(b"\n"):
            return None
        return Position(status.st_ino % _INODES, file.tell())


def _goes_on(file: BinaryIO, position: Position, inode: int, size: int) -> bool:
    """Whether a file is still the one that was read up to a position, as far as can be told."""
    if position.inode != inode or size < position.offset:
        return False
    if position.offset == 0:
        return True
    file.seek(position.offset - 1)
    return file.read(1) == b"\n"


def _line_end(file: BinaryIO) -> int:
    """The offset behind the next newline; 0: there is none yet."""
    while piece := file.read(READ_BYTES):
        found = piece.find(b"\n")
        if found >= 0:
            return file.tell() - len(piece) + found + 1
    return 0


class Tail:
    """A file that is followed; remembers how far.

    Args:
        position: where to begin; None: at the beginning.
        root: as of `read_on`.
    """

    def __init__(
        self, path: Path, position: Position | None = None, *, root: Path | None = None
    ) -> None:
        self.path, self.position, self._root = path, position, root

    def read(self, limit: int = READ_BYTES) -> Growth:
        """What was added since the last call.

        Raises:
            OSError: as `read_on`; the next call tries again.
        """
        growth = read_on(self.path, self.position, limit, root=self._root)
        self.position = growth.position
        return growth


def newest(records: Iterable[Record], iteration: Callable[[Record], int]) -> list[Record]:
    """Each iteration once and in order: after a crash one may stand twice, and the later counts."""
    by_iteration = {iteration(record): record for record in records}
    return [by_iteration[index] for index in sorted(by_iteration)]
