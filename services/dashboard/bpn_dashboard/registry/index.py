"""The database as an index over the run folders: taking in new ones, and building all of it anew."""

import contextlib
import logging
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.about import SWEEPS, SweepFile
from bpn_dashboard.registry.folders import row_of, run_folders
from bpn_shared.config import ConfigError
from bpn_shared.runs.opening import file_names

log = logging.getLogger(__name__)


@dataclass
class Rebuilt:
    """What became of a rebuild; `damaged` says why a folder or file was left out."""

    runs: int = 0
    sweeps: int = 0
    removed: int = 0
    damaged: list[str] = field(default_factory=list)


class Index:
    """Rows from folders.

    Attributes:
        making: held by whoever makes a run, while that has a folder and no row yet.
    """

    def __init__(self, database: Database, runs_dir: Path) -> None:
        self._database, self._runs_dir = database, runs_dir
        self.making = threading.Lock()
        self._damaged: set[str] = set()
        self._seen_s: dict[str, float] | None = None  # by run, when its state was last written

    def adopt(self) -> list[RunRow]:
        """Adds rows for the folders that have none, and returns them."""
        with self.making:
            with self._database.reading() as session:
                known = set(session.scalars(select(RunRow.id)))
                sweeps = set(session.scalars(select(SweepRow.id)))
            damaged: list[str] = []
            rows = self._rows(known | self._damaged, sweeps, damaged)
            for reason in damaged:
                log.warning("a run folder cannot be read and is left out: %s", reason)
            if rows:
                with self._database.writing() as session:
                    session.add_all(rows)
        return rows

    def changed(self, session: Session) -> list[str]:
        """The runs whose state was written since the last call, or since it was last observed."""
        written_s = dict(_states_written_s(self._runs_dir))
        if self._seen_s is None:
            known = session.execute(select(RunRow.id, RunRow.updated_at))
            self._seen_s = dict(iter(known))
        seen_s, self._seen_s = self._seen_s, written_s
        return [run for run, at_s in written_s.items() if at_s > seen_s.get(run, float("inf"))]

    def rebuild(self) -> Rebuilt:
        """Makes the rows be what the folders say; rows of runs and sweeps that have none go."""
        result = Rebuilt()
        sweeps = self._sweeps(result.damaged)
        kept = {sweep.id for sweep in sweeps}
        with self.making:
            rows = self._rows(set(), kept, result.damaged)
            with self._database.writing() as session:
                for sweep in sweeps:
                    session.merge(sweep)
                session.flush()
                for row in rows:
                    session.merge(row)
                session.flush()
                gone = set(session.scalars(select(RunRow.id))) - {row.id for row in rows}
                for run_id in gone:
                    session.execute(delete(RunRow).where(RunRow.id == run_id))
                session.execute(delete(SweepRow).where(SweepRow.id.not_in(kept)))
        result.runs, result.sweeps, result.removed = len(rows), len(sweeps), len(gone)
        return result

    def _rows(self, leave_out: set[str], sweeps: set[str], damaged: list[str]) -> list[RunRow]:
        rows = []
        for folder in run_folders(self._runs_dir):
            if folder.path.name in leave_out:
                continue
            try:
                row = row_of(folder)
            except ConfigError as error:
                self._damaged.add(folder.path.name)
                damaged.append(str(error))
                continue
            if row.sweep_id not in sweeps:
                row.sweep_id = None
            rows.append(row)
        return rows

    def _sweeps(self, damaged: list[str]) -> list[SweepRow]:
        sweeps = []
        for name in file_names(self._runs_dir, SWEEPS, suffix=".json"):
            try:
                sweeps.append(SweepFile.read(self._runs_dir, name))
            except ConfigError as error:
                damaged.append(str(error))
        return sweeps


def _states_written_s(runs_dir: Path) -> Iterator[tuple[str, float]]:
    for path in os.scandir(runs_dir) if runs_dir.exists() else ():
        with contextlib.suppress(OSError):
            yield path.name, os.stat(f"{path.path}/state.json").st_mtime
