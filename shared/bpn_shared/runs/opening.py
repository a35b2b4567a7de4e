"""How files in run folders are opened: nothing that was planted there leads out, or makes its reader wait.

Others than the reader write run folders, and may be taken over. So below the directory in which the run folders
are, nothing is a way but plain directories, and nothing is a file but regular ones: no link is followed, not even
one that takes a directory's place between two looks, and a pipe does not block.
"""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import BinaryIO
from uuid import UUID

MAX_READ_BYTES = 256 * 1024 * 1024
"""Of a file that is read as a whole: far more than any of ours has, and less than a machine's memory."""

_DIRECTORY = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC


class ForeignFileError(OSError):
    """Something that is no file or directory of a run's own stands at a path."""


def open_file(root: Path, name: str | PurePath) -> BinaryIO:
    """Opens a regular file for reading.

    Args:
        root: a directory that is trusted, such as the one of all run folders; links may lead to it.
        name: of the file, relative to `root`; "..", "." and absolute ones are refused.

    Raises:
        FileNotFoundError: there is nothing.
        ForeignFileError: a part of the name is a link, or what it names is no regular file.
        OSError: it cannot be opened.
    """
    *folders, last = _parts(name)
    with open_folder(root, PurePath(*folders)) as folder:
        flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        try:
            descriptor = os.open(last, flags, dir_fd=folder)
        except OSError as error:
            if error.errno in (errno.ELOOP, errno.ENXIO):  # ENXIO: a socket
                raise _foreign(root, name) from error
            raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise _foreign(root, name)
    return os.fdopen(descriptor, "rb")


def read_file(root: Path, name: str | PurePath, *, limit_bytes: int = MAX_READ_BYTES) -> bytes:
    """All of a regular file of at most `limit_bytes`.

    Raises:
        ForeignFileError: as `open_file`, or the file is larger.
        OSError: as `open_file`.
    """
    with open_file(root, name) as file:
        data = file.read(limit_bytes + 1)
    if len(data) > limit_bytes:
        reason = f"has more than {limit_bytes} bytes, which none of a run's own has"
        raise ForeignFileError(errno.EFBIG, reason, str(root / name))
    return data


@contextlib.contextmanager
def open_folder(root: Path, name: str | PurePath = "") -> Iterator[int]:
    """A descriptor of a directory below `root`, or of `root` itself, while the body runs.

    Raises:
        FileNotFoundError: there is nothing.
        ForeignFileError: a part of the name is a link or no directory.
        OSError: it cannot be opened.
    """
    descriptor = os.open(root, _DIRECTORY)
    try:
        for part in _parts(name):
            try:
                inner = os.open(part, _DIRECTORY | os.O_NOFOLLOW, dir_fd=descriptor)
            except NotADirectoryError as error:  # which a link is, too
                raise _foreign(root, name) from error
            os.close(descriptor)
            descriptor = inner
        yield descriptor
    finally:
        os.close(descriptor)


def file_names(root: Path, name: str | PurePath = "", *, suffix: str = "") -> list[str]:
    """The names of the regular files in a directory, sorted; none where there is no such directory.

    Args:
        root, name: as of `open_folder`.
        suffix: with which they end.
    """
    return _names(root, name, suffix, of_files=True)


def folder_names(root: Path, name: str | PurePath = "") -> list[str]:
    """The names of the directories in a directory, without links to some; else as `file_names`."""
    return _names(root, name, "", of_files=False)


def size_bytes(root: Path, name: str | PurePath = "") -> int:
    """Of all files in a directory and those below it, as long as they are.

    Raises:
        OSError: as `open_folder`, or one cannot be looked at.
    """
    with open_folder(root, name) as folder:
        return sum(
            os.stat(file, dir_fd=inner, follow_symlinks=False).st_size
            for _, _, files, inner in os.fwalk(".", dir_fd=folder, onerror=_raise)
            for file in files
        )


def is_run_id(name: str) -> bool:
    """Whether a name is a run's id, in the one spelling that counts."""
    try:
        return str(UUID(name)) == name
    except ValueError:
        return False


def _raise(error: OSError) -> None:
    raise error


def _names(root: Path, name: str | PurePath, suffix: str, *, of_files: bool) -> list[str]:
    try:
        with open_folder(root, name) as folder, os.scandir(folder) as entries:
            return sorted(
                entry.name
                for entry in entries
                if entry.name.endswith(suffix)
                and (entry.is_file if of_files else entry.is_dir)(follow_symlinks=False)
            )
    except (FileNotFoundError, ForeignFileError):
        return []


def _parts(name: str | PurePath) -> tuple[str, ...]:
    path = PurePath(name)
    if path.is_absolute() or ".." in path.parts or "\0" in str(path):
        raise ForeignFileError(errno.EINVAL, "is no name inside a run folder", str(name))
    return path.parts


def _foreign(root: Path, name: str | PurePath) -> ForeignFileError:
    return ForeignFileError(
        errno.ELOOP, "is a link, or no file or directory of a run's own", str(root / name)
    )
