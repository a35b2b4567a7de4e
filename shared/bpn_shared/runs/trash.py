"""The trash of a runs directory: a run is taken away by one rename, and brought back by another.

    .trash/<run id>/        the folder as it was
    .trash/<run id>.json    who removed it and when, and until when it is kept; without it its own times count

Nothing is copied, so a full disk hinders neither. Of two callers one does it, the other is told. What is deleted
for good first gets a name that nobody restores, so a folder that is restored is never half there.
"""

import contextlib
import errno
import logging
import os
import secrets
import shutil
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_shared.errors import InputError, one_line
from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.runs.files import naming, write_atomically
from bpn_shared.runs.lock import kept_from_owners
from bpn_shared.runs.opening import (
    file_names,
    folder_names,
    is_run_id,
    open_folder,
    read_file,
    size_bytes,
)

log = logging.getLogger(__name__)

TRASH = ".trash"
KEPT_DAYS = 7.0
DAY_S = 86_400.0

_DOOMED = ".deleting."
_OCCUPIED = (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR)


class NotThereError(InputError):
    """No such run is there, or in the trash; the message says where it is instead."""


class OccupiedError(InputError):
    """Another run of that id stands where this one should go; the message says where."""


class Removed(BaseModel):
    """A run in the trash."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    run: str
    by: str
    """Who removed it; "": that could not be written down."""
    at_unix_s: Annotated[float, Field(allow_inf_nan=False)]
    until_unix_s: Annotated[float, Field(allow_inf_nan=False)]
    """From then on it is deleted for good when the trash is next looked through."""
    size_bytes: Annotated[int, Field(ge=0)] | None = None
    """Of its files, as it was removed; None: that is not written down."""


class Trash:
    """Any number of processes may use it at once.

    Args:
        kept_s: how long runs that are removed from now on are kept.
    """

    def __init__(self, runs_dir: Path, kept_s: float = KEPT_DAYS * DAY_S) -> None:
        self._runs_dir, self._kept_s = runs_dir, kept_s

    @property
    def path(self) -> Path:
        """Where the removed folders are."""
        return self._runs_dir / TRASH

    def put(self, run: str, by: str) -> Removed:
        """Removes a run.

        Args:
            by: who does it, for others to read.

        Raises:
            NotThereError: there is no such run, or no longer.
            OccupiedError: one of its id is in the trash.
            RunOwnedError: a learner is at work on it.
            OSError: it cannot be moved; it is where it was.
        """
        path = self._runs_dir / run
        with self._found(run), naming(path):
            self._make()
            with kept_from_owners(path / ".lock"), self._opened() as (runs, trash):
                self._unlink_note(run)
                _move(
                    run, runs, trash, f"a run {run} is in the trash already: delete that one first"
                )
                return self._note(run, by)

    def restore(self, run: str) -> None:
        """Brings a run back, as it was.

        Raises:
            NotThereError: it is not in the trash, or no longer.
            OccupiedError: there is one of its id again.
            OSError: it cannot be moved; it is where it was.
        """
        with self._found(run), naming(self.path / run), self._opened() as (runs, trash):
            _move(run, trash, runs, f"there is a run {run} again: remove that one first")
        self._unlink_note(run)

    def delete(self, run: str) -> None:
        """Deletes a removed run for good.

        Raises:
            NotThereError: it is not in the trash, or no longer.
            OSError: something in it cannot be deleted; what is left of it is tried again by `sweep_up`.
        """
        doomed = f"{_DOOMED}{run}.{secrets.token_hex(4)}"
        with self._found(run), naming(self.path / run), self._opened() as (_, trash):
            os.rename(run, doomed, src_dir_fd=trash, dst_dir_fd=trash)
        self._unlink_note(run)
        self._erase(doomed)

    def sweep_up(self) -> None:
        """Deletes what a deletion that was interrupted has left.

        Raises:
            OSError: something cannot be deleted.
        """
        for name in folder_names(self._runs_dir, TRASH):
            if name.startswith(_DOOMED):
                self._erase(name)
        removed = self.names()
        for note in file_names(self._runs_dir, TRASH, suffix=".json"):
            if note.removesuffix(".json") not in removed:
                self._unlink_note(note.removesuffix(".json"))

    def names(self) -> list[str]:
        """The ids of the removed runs, in their order."""
        return [name for name in folder_names(self._runs_dir, TRASH) if is_run_id(name)]

    def contents(self) -> list[Removed]:
        """The removed runs, those removed last first."""
        found = [removed for run in self.names() if (removed := self.find(run)) is not None]
        return sorted(found, key=lambda removed: (removed.at_unix_s, removed.run), reverse=True)

    def find(self, run: str) -> Removed | None:
        """A removed run; None if it is not in the trash."""
        if not is_run_id(run):
            return None
        try:
            with open_folder(self._runs_dir, f"{TRASH}/{run}") as folder:
                at_s = os.fstat(
                    folder
                ).st_ctime  # when it was renamed, where nobody has touched it since
        except OSError:
            return None
        with contextlib.suppress(OSError, DamagedError, ValidationError):
            values, _ = unseal(read_file(self._runs_dir, f"{TRASH}/{run}.json"))
            return Removed.model_validate(values | {"run": run})
        return self._removed(run, "", at_s)

    def _removed(self, run: str, by: str, at_s: float) -> Removed:
        return Removed(run=run, by=by, at_unix_s=at_s, until_unix_s=at_s + self._kept_s)

    def _note(self, run: str, by: str) -> Removed:
        removed = self._removed(run, by, time.time())
        removed = removed.model_copy(update={"size_bytes": self._size_bytes(run)})
        data = seal(removed.model_dump(exclude={"run"}))
        try:
            write_atomically(self.path / f"{run}.json", data, root=self._runs_dir)
        except OSError as error:  # as on a full disk; the run is removed all the same
            log.warning("who removed run %s is not written down: %s", run, one_line(error))
        return removed

    def _size_bytes(self, run: str) -> int | None:
        try:
            return size_bytes(self._runs_dir, f"{TRASH}/{run}")
        except OSError as error:
            log.warning("how large run %s is cannot be told: %s", run, one_line(error))
            return None

    def _unlink_note(self, run: str) -> None:
        with self._opened() as (_, trash), contextlib.suppress(FileNotFoundError):
            os.unlink(f"{run}.json", dir_fd=trash)

    def _make(self) -> None:
        with contextlib.suppress(FileExistsError):
            self.path.mkdir()

    @contextlib.contextmanager
    def _found(self, run: str) -> Iterator[None]:
        """Says where a run is instead that the body does not find."""
        try:
            if not is_run_id(run):  # it becomes a path
                raise FileNotFoundError
            yield
        except FileNotFoundError as error:
            raise NotThereError(self._whereabouts(run)) from error

    @contextlib.contextmanager
    def _opened(self) -> Iterator[tuple[int, int]]:
        with open_folder(self._runs_dir) as runs, open_folder(self._runs_dir, TRASH) as trash:
            yield runs, trash

    def _erase(self, doomed: str) -> None:
        gone = contextlib.suppress(FileNotFoundError)  # another process does it, too
        with gone, self._opened() as (_, trash), naming(self.path / doomed):
            if stat.S_ISDIR(os.stat(doomed, dir_fd=trash, follow_symlinks=False).st_mode):
                shutil.rmtree(doomed, dir_fd=trash)
            else:
                os.unlink(doomed, dir_fd=trash)

    def _whereabouts(self, run: str) -> str:
        """Why a run cannot be had: somebody else was faster, or it never was here."""
        if (removed := self.find(run)) is not None:
            by = f"{removed.by} removed it" if removed.by else "it was removed"
            return f"run {run} is in the trash ({by}): `bpn runs restore {run}` brings it back"
        if run in folder_names(self._runs_dir):
            return f"run {run} is not in the trash: it is where it was"
        return f"there is no run {run}, and none in the trash"


def _move(run: str, source: int, target: int, occupied: str) -> None:
    """Moves a folder, and nothing else, from one directory to another; the move is on disk when this returns."""
    if not stat.S_ISDIR(os.stat(run, dir_fd=source, follow_symlinks=False).st_mode):
        raise FileNotFoundError
    try:
        os.rename(run, run, src_dir_fd=source, dst_dir_fd=target)
    except OSError as error:
        if error.errno in _OCCUPIED:
            raise OccupiedError(occupied) from error
        raise
    os.fsync(target)
    os.fsync(source)
