"""How files at rest are written: whole or not at all, and on disk when the writer says so."""

import json
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_atomically(path: Path, data: bytes, *, mode: int = 0o666) -> None:
    """Replaces a file so that a reader, or a crash at any moment, finds the old or the new one whole.

    Contents and name are on disk when this returns. A link that stands at the path is replaced, not followed.

    Args:
        mode: permissions of the file, less the process's umask.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    try:
        with os.fdopen(os.open(temporary, flags, mode), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def append_line(path: Path, record: Mapping[str, Any]) -> None:
    """Appends a record as one line of JSON, after a newline if a crash cut the last line.

    It is on disk when this returns.

    Raises:
        ValueError: a number is not finite.
    """
    line = json.dumps(record, allow_nan=False) + "\n"
    is_new = not path.exists()
    with path.open("ab+") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                line = "\n" + line
        file.write(line.encode())
        file.flush()
        os.fsync(file.fileno())
    if is_new:
        sync_directory(path.parent)


def sync_directory(path: Path) -> None:
    """Brings the names in a directory to disk: without it a power cut may undo a rename."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
