"""How files at rest are written: whole or not at all, and on disk when the writer says so."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import BinaryIO

from bpn_shared.runs.opening import ForeignFileError, open_file, open_folder

Prove = Callable[[], None]
"""Called last before a write takes place; what it raises keeps it from that."""


def free() -> None:
    """Nobody needs to prove anything."""


def write_atomically(
    path: Path, data: bytes, *, mode: int = 0o666, root: Path | None = None, prove: Prove = free
) -> None:
    """Replaces a file so that a reader, or a crash at any moment, finds the old or the new one whole.

    Contents and name are on disk when this returns. A link that stands at the path is replaced, not followed.

    Args:
        mode: permissions of the file, less the process's umask.
        root: a directory above the file, between which and the file no link is followed either; others than
             this process may write there. Without it, links may lead to the file's directory.

    Raises:
        ForeignFileError: there is a link, or no directory, between `root` and the file.
        OSError: it cannot be written; nothing of it is left.
    """
    _replace(path, lambda file: file.write(data), mode, root or path.parent, prove)


def _replace(
    path: Path, write: Callable[[BinaryIO], object], mode: int, root: Path, prove: Prove
) -> None:
    temporary = f".{path.name}.{secrets.token_hex(6)}.new"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    with naming(path), open_folder(root, path.parent.relative_to(root)) as folder:
        try:
            with os.fdopen(os.open(temporary, flags, mode, dir_fd=folder), "wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            prove()
            os.replace(temporary, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary, dir_fd=folder)
            raise
        os.fsync(folder)


def append_line(path: Path, line: bytes, *, root: Path | None = None, prove: Prove = free) -> None:
    """Appends a line, after a newline if a crash cut the last one. It is on disk when this returns.

    Args:
        root: as of `write_atomically`.
        prove: called with the file open.

    Raises:
        ForeignFileError: there is a link, or no directory, between `root` and the file.
        OSError: it cannot be written; the file is as it was.
    """
    root = root or path.parent
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    with naming(path), open_folder(root, path.parent.relative_to(root)) as folder:
        descriptor = os.open(path.name, flags, 0o666, dir_fd=folder)
        try:
            size = os.fstat(descriptor).st_size
            is_torn = size > 0 and os.pread(descriptor, 1, size - 1) != b"\n"
            left = memoryview((b"\n" if is_torn else b"") + line + b"\n")
            prove()
            try:
                while left:
                    left = left[os.write(descriptor, left) :]
                os.fsync(descriptor)
            except OSError:
                os.ftruncate(descriptor, size)
                raise
        finally:
            os.close(descriptor)
        if size == 0:
            os.fsync(folder)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Errors of the system name this path: a full disk names none, an unfinished file another."""
    try:
        yield
    except OSError as error:
        if error.errno is None or isinstance(error, ForeignFileError):
            raise
        raise type(error)(error.errno, error.strerror, str(path)) from error


def remove_unfinished(folder: Path, names: str) -> None:
    """Takes from under writers what they have not put in its place yet: they then cannot any more.

    Args:
        names: pattern of the files' names.
    """
    for path in folder.glob(f".{names}.*.new"):
        path.unlink(missing_ok=True)


def shut_out_appenders(path: Path, root: Path) -> None:
    """Puts a copy in the place of a file: what others who have it open append to it is lost."""
    try:
        opened = open_file(root, path.relative_to(root))
    except FileNotFoundError:
        return
    with opened as source:
        _replace(path, partial(shutil.copyfileobj, source), 0o666, root, free)
