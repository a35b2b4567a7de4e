"""The database as an index over the run folders: taking in new ones, and building all of it anew."""

import contextlib
import logging
import os
import threading
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import delete, select
from sqlalchemy.exc import OperationalError, StatementError
from sqlalchemy.orm import Session

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.about import SWEEPS, SweepFile
from bpn_dashboard.registry.folders import Signature, candidates, row_of, signature, why_none
from bpn_dashboard.series import store as series_store
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.opening import file_names
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)

_UNSTORABLE = (StatementError, ValueError, ArithmeticError)
"""What a database says of values that it cannot hold."""


@dataclass
class Rebuilt:
    """What became of a rebuild; `damaged` says why a folder or file was left out."""

    runs: int = 0
    sweeps: int = 0
    removed: int = 0
    damaged: list[str] = field(default_factory=list)


class _Unreadable(NamedTuple):
    reason: str
    signature: Signature
    """Of the folder when it could not be read: when that changes, it is looked at again."""


class Index:
    """Rows from folders.

    Attributes:
        making: held by whoever makes, removes or restores a run, while that has a folder and no row, or a row and
            no folder.
        gone: runs that have a row still, because the database takes nothing now, and no folder.
    """

    def __init__(self, database: Database, runs_dir: Path) -> None:
        self._database, self._runs_dir = database, runs_dir
        self.making = threading.Lock()
        self.gone: frozenset[str] = frozenset()
        self._unreadable: dict[str, _Unreadable] = {}
        self._seen_s: dict[str, float] | None = None  # by run, when its state was last written

    def unreadable(self) -> dict[str, str]:
        """The folders that cannot be read, or not wholly, and why."""
        return {name: known.reason for name, known in sorted(self._unreadable.items())}

    def adopt(self) -> list[RunRow]:
        """Adds rows for the folders that have none, and for those that were mended; returns them.

        Rows without a hash are of an older database's schema, and are made anew.
        """
        with self.making:
            with self._database.reading() as session:
                known = set(session.scalars(select(RunRow.id).where(RunRow.config_hash != "")))
                sweeps = set(session.scalars(select(SweepRow.id)))
            rows = list(self._rows(known, sweeps))
            try:
                self._merge(rows)
                return rows
            except _UNSTORABLE:
                return [row for row in rows if self._merge_alone(row)]

    def drop_vanished(self) -> frozenset[str]:
        """Deletes the rows of runs whose folders are not there any more, whoever removed them; returns which.

        The database may take nothing, as on a full disk: then they are `gone`, and it is tried again next time.
        """
        if not self._runs_dir.is_dir():  # an unmounted disk, of which nothing is known
            return frozenset()
        with self.making:
            with self._database.reading() as session:
                known = set(session.scalars(select(RunRow.id)))
            vanished = frozenset(
                known - {folder.path.name for folder in candidates(self._runs_dir)}
            )
            news = vanished - self.gone
            try:
                self.drop(vanished)
            except OperationalError as error:
                if news:
                    log.warning("the rows of removed runs stay for now: %s", error.orig)
                self.gone = vanished
        return news

    def drop(self, run_ids: frozenset[str]) -> None:
        """Deletes these runs' rows, and their curves."""
        if run_ids:
            with self._database.writing() as session:
                forget(session, run_ids)
        self.gone = frozenset()

    def _merge(self, rows: Sequence[RunRow]) -> None:
        if rows:
            with self._database.writing() as session:
                for row in rows:
                    session.merge(row)

    def _merge_alone(self, row: RunRow) -> bool:
        """Whether the row could be stored; one that cannot leaves the others alone."""
        try:
            self._merge([row])
        except OperationalError:  # the database's trouble
            raise
        except _UNSTORABLE as error:
            self._leave_out(RunFolder(self._runs_dir / row.id), error)
            return False
        return True

    def changed(self, session: Session) -> list[str]:
        """The runs whose state was written since the last call, or since it was last observed."""
        written_s = dict(_states_written_s(self._runs_dir))
        if self._seen_s is None:
            known = session.execute(select(RunRow.id, RunRow.updated_at, RunRow.folder_at))
            self._seen_s = {run: max(seen_s, read_s or 0.0) for run, seen_s, read_s in known}
        seen_s, self._seen_s = self._seen_s, written_s
        return [run for run, at_s in written_s.items() if at_s > seen_s.get(run, float("inf"))]

    def rebuild(self) -> Rebuilt:
        """Makes the rows be what the folders say; rows of runs and sweeps that have none go."""
        result = Rebuilt()
        sweeps = self._sweeps(result.damaged)
        kept = {sweep.id for sweep in sweeps}
        with self.making:
            self._unreadable.clear()
            rows = list(self._rows(set(), kept))
            result.damaged += self.unreadable().values()
            with self._database.writing() as session:
                for sweep in sweeps:
                    session.merge(sweep)
                session.flush()
                for row in rows:
                    session.merge(row)
                session.flush()
                gone = set(session.scalars(select(RunRow.id))) - {row.id for row in rows}
                forget(session, gone)
                session.execute(delete(SweepRow).where(SweepRow.id.not_in(kept)))
        result.runs, result.sweeps, result.removed = len(rows), len(sweeps), len(gone)
        return result

    def _rows(self, known: set[str], sweeps: set[str]) -> Iterator[RunRow]:
        names = set()
        for folder in candidates(self._runs_dir):
            name = folder.path.name
            names.add(name)
            before = self._unreadable.get(name)
            if (name in known and before is None) or (before and before[1] == signature(folder)):
                continue
            try:
                if (reason := why_none(folder)) is not None:
                    raise ConfigError(reason)
                now = signature(folder)
                row = row_of(folder)
                self._unreadable.pop(name, None)
                if (unreadable := _unreadable_part(folder)) is not None:
                    self._note(name, unreadable, now)
            except Exception as error:  # whatever lies in one folder, the others go on
                self._leave_out(folder, error)
                continue
            if row.sweep_id not in sweeps:
                row.sweep_id = None
            yield row
        self._unreadable = {n: known for n, known in self._unreadable.items() if n in names}

    def _leave_out(self, folder: RunFolder, error: Exception) -> None:
        expected = isinstance(error, ConfigError | OSError)
        reason = str(error) if expected else f"{folder.path}: {type(error).__name__}: {error}"
        self._note(folder.path.name, reason, signature(folder))

    def _note(self, name: str, reason: str, seen: Signature) -> None:
        before = self._unreadable.get(name)
        self._unreadable[name] = _Unreadable(reason, seen)
        if before is None or before.reason != reason:
            log.warning("a run folder cannot be read: %s", reason)

    def _sweeps(self, damaged: list[str]) -> list[SweepRow]:
        sweeps = []
        for name in file_names(self._runs_dir, SWEEPS, suffix=".json"):
            try:
                sweeps.append(SweepFile.read(self._runs_dir, name))
            except ConfigError as error:
                damaged.append(str(error))
        return sweeps


def forget(session: Session, run_ids: Collection[str]) -> None:
    """Deletes rows of runs, and their curves."""
    for run_id in run_ids:
        session.execute(delete(RunRow).where(RunRow.id == run_id))
        series_store.forget(session, run_id)


def _unreadable_part(folder: RunFolder) -> str | None:
    """Why a folder that has a row is not shown wholly."""
    try:
        folder.config()
    except ConfigError as error:
        return str(error)
    return None


def _states_written_s(runs_dir: Path) -> Iterator[tuple[str, float]]:
    for path in os.scandir(runs_dir) if runs_dir.exists() else ():
        with contextlib.suppress(OSError):
            yield path.name, os.stat(f"{path.path}/state.json").st_mtime
