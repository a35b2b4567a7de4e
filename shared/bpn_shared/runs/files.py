"""How files at rest are written: whole or not at all, and on disk when the writer says so."""

import contextlib
import json
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bpn_shared.runs.opening import open_folder


def write_atomically(
    path: Path, data: bytes, *, mode: int = 0o666, root: Path | None = None
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
    root = root or path.parent
    temporary = f".{path.name}.{secrets.token_hex(6)}.new"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    with open_folder(root, path.parent.relative_to(root)) as folder:
        try:
            with os.fdopen(os.open(temporary, flags, mode, dir_fd=folder), "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary, dir_fd=folder)
            raise
        os.fsync(folder)


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
