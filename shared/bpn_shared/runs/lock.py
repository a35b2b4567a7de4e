"""The lock of a run folder: one learner at a time owns it, on every machine that shares the folder.

The owner touches the lock file every few seconds. Where it has not for longer than `SILENT_S`, its process is
frozen or its machine cut off, and the next learner puts a lock file of its own in that one's place. What keeps the
old owner from writing when it thaws is the attempt (`bpn_shared.runs.ownership`), not the lock.
"""

import contextlib
import errno
import fcntl
import os
import secrets
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from bpn_shared.runs.opening import open_folder
from bpn_shared.spec.config import ConfigError

SILENT_S = 30.0
_TOUCH_S = 3.0
_TOUCHED = f"touches this file every {_TOUCH_S:g} s"
"""What the second line says: owners of older versions do not, and are never silent."""
_FOREIGN = (errno.ELOOP, errno.EISDIR, errno.ENXIO)
_FULL = (errno.ENOSPC, errno.EDQUOT)


class RunOwnedError(RuntimeError):
    """Another learner works on the run; the message says which."""


class OwnershipLostError(RunOwnedError):
    """Another learner has taken the run over meanwhile: this one writes nothing more."""


@contextlib.contextmanager
def locked(path: Path, owner: str, patience_s: float) -> Iterator[None]:
    """Holds the lock while the body runs.

    Args:
        owner: who asks, for the message that others get.
        patience_s: how long to wait for an owner that is just ending.

    Raises:
        RunOwnedError: another owns it.
        ConfigError: there is something else in its place.
    """
    descriptor = _acquire(path, patience_s)
    done = threading.Event()
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{owner}\n{_TOUCHED}\n".encode(), 0)
        thread = threading.Thread(target=_touch, args=(descriptor, done), name="lock", daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def kept_from_owners(path: Path, patience_s: float = 0.5) -> Iterator[None]:
    """Nobody is or becomes the owner while the body runs. Nothing is written, so that a full disk is no obstacle.

    The body may move the folder: whoever waited for the lock then finds none where it was.

    Raises:
        RunOwnedError: somebody is.
        FileNotFoundError: there is no such folder.
        OSError, ConfigError: as of `locked`, or the folder is a link.
    """
    with open_folder(path.parent.parent, path.parent.name) as folder:
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        made = True
        try:
            os.close(os.open(path.name, flags, 0o666, dir_fd=folder))
        except FileExistsError:
            made = False
        except OSError as error:
            if error.errno not in _FULL:
                raise
            yield  # what cannot be made now has no owner
            return
        descriptor = _acquire(path, patience_s)
        try:
            yield
        finally:
            if made:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(path.name, dir_fd=folder)
            os.close(descriptor)


def is_locked(path: Path) -> bool:
    """Whether somebody holds the lock and is not silent.

    Raises:
        ConfigError: there is something else in its place.
    """
    try:
        descriptor = _open(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        return not _flock(descriptor, fcntl.LOCK_SH) and not _is_silent(path, descriptor)
    finally:
        os.close(descriptor)


def _acquire(path: Path, patience_s: float) -> int:
    deadline_s = time.monotonic() + patience_s
    while True:
        descriptor = _open(path, os.O_RDWR | os.O_CREAT)
        try:
            if _flock(descriptor, fcntl.LOCK_EX):
                if _stands_at(path, descriptor):
                    return descriptor
                os.close(descriptor)
                continue
            if _is_silent(path, descriptor):
                replacement = _replace(path)
                os.close(descriptor)
                return replacement
            if time.monotonic() > deadline_s:
                raise RunOwnedError(
                    f"run {path.parent.name} is being learned by {_owner(descriptor) or 'another learner'}: "
                    f"wait for its end, or stop it there (`bpn runs stop {path.parent.name}`)"
                )
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        time.sleep(0.05)


def _replace(path: Path) -> int:
    """Puts a lock file that is held in the place of a silent owner's."""
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(6)}")
    descriptor = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        if not _flock(descriptor, fcntl.LOCK_EX):
            raise AssertionError("a file that nobody knows of is locked")
        os.replace(temporary, path)
    except BaseException:
        os.close(descriptor)
        temporary.unlink(missing_ok=True)
        raise
    return descriptor


def _open(path: Path, flags: int) -> int:
    try:
        descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno in (errno.ENOENT, *_FULL):
            raise
        remedy = "; remove it, it is no lock file" if error.errno in _FOREIGN else ""
        raise ConfigError(f"{path}: {error.strerror}{remedy}") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise ConfigError(f"{path} is no regular file: remove it, it is no lock file")
    return descriptor


def _stands_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(follow_symlinks=False), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _owner(descriptor: int) -> str:
    return os.pread(descriptor, 200, 0).decode(errors="replace").split("\n")[0]


def _is_silent(path: Path, descriptor: int) -> bool:
    if _TOUCHED not in os.pread(descriptor, 400, 0).decode(errors="replace"):
        return False
    touched_s = os.fstat(descriptor).st_mtime
    if abs(time.time() - touched_s) < SILENT_S / 2:
        return False  # no need to ask the file system
    return _file_system_time_s(path.parent) - touched_s > SILENT_S


def _file_system_time_s(folder: Path) -> float:
    """Now, on the clock that dates the folder's files: it may be another machine's."""
    probe = folder / f".now.{secrets.token_hex(6)}"
    try:
        descriptor = os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    except OSError:  # full, or not ours to write
        return 0.0
    try:
        return os.fstat(descriptor).st_mtime
    finally:
        os.close(descriptor)
        probe.unlink(missing_ok=True)


def _touch(descriptor: int, done: threading.Event) -> None:
    while not done.wait(_TOUCH_S):
        with contextlib.suppress(OSError):  # the owner stays it: others see that it is silent
            os.utime(descriptor)


def _flock(descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
