"""How files at rest are written: whole or not at all, and on disk when the writer says so."""

import os
import secrets
from collections.abc import Callable
from pathlib import Path


def write_atomically(
    path: Path, data: bytes, *, mode: int = 0o666, prove: Callable[[], None] = lambda: None
) -> None:
    """Replaces a file so that a reader, or a crash at any moment, finds the old or the new one whole.

    Contents and name are on disk when this returns. A link that stands at the path is replaced, not followed.

    Args:
        mode: permissions of the file, less the process's umask.
        prove: called last before the file is in its place; what it raises leaves the old one there.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    try:
        with os.fdopen(os.open(temporary, flags, mode), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        prove()
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def remove_unfinished(folder: Path, names: str) -> None:
    """Takes from under writers what they have not put in its place yet: they then cannot any more.

    Args:
        names: pattern of the files' names.
    """
    for path in folder.glob(f".{names}.*.new"):
        path.unlink(missing_ok=True)


def shut_out_appenders(path: Path) -> None:
    """Puts a copy in the place of a file: what others who have it open append to it is lost."""
    if path.exists():
        write_atomically(path, path.read_bytes())


def append_line(path: Path, line: bytes, *, prove: Callable[[], None] = lambda: None) -> None:
    """Appends a line, after a newline if a crash cut the last one. It is on disk when this returns.

    A link that stands at the path is not followed. What cannot be written whole is taken back.

    Args:
        prove: called with the file open, last before it is written to.

    Raises:
        OSError: it cannot be written; the file is as it was.
    """
    is_new = not path.exists()
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
    descriptor = os.open(path, flags, 0o666)
    try:
        size = os.fstat(descriptor).st_size
        torn = size > 0 and os.pread(descriptor, 1, size - 1) != b"\n"
        left = memoryview((b"\n" if torn else b"") + line + b"\n")
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
    if is_new:
        sync_directory(path.parent)


def sync_directory(path: Path) -> None:
    """Brings the names in a directory to disk: without it a power cut may undo a rename."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
