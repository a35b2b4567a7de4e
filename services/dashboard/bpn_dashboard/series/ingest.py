"""From the run folders' metrics.jsonl into the series store, as the lines are written.

How far a file was read is stored with what was read, in one transaction: whenever this process dies, the next one
goes on at the same byte. A folder is the truth, so a file that was replaced or cut is read from the start.
"""

import math
import os
import threading
import time
from collections.abc import Collection, Sequence
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.exc import OperationalError

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.series_tables import SourceRow
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.series import store
from bpn_dashboard.series.lines import parse_lines
from bpn_shared.counters import Counters
from bpn_shared.runs.tail import Growth, Position, read_on

POLL_S = 0.25
SCAN_S = 2.0
_SCAN_SHARE = 0.02
"""Of the time that looking at all files may take, however many there are."""
_ACTIVE_S = 600.0
_AGAIN_S = 5.0
_FILE = "metrics.jsonl"


class Ingest:
    """Follows the metrics of every run of a folder, once started in a thread of its own.

    Files that grew in the last ten minutes are looked at every 0.25 s, the others every 2 s.
    """

    def __init__(self, runs_dir: Path, database: Database, counters: Counters) -> None:
        self._runs_dir = runs_dir
        self._database = database
        self._counters = counters
        self._active: dict[str, float] = {}
        self._scan_at_s = -math.inf
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._follow, name="ingest", daemon=True)
        with database.reading() as session:
            rows = session.scalars(select(SourceRow))
            self._read: dict[str, Position] = {
                row.run_id: Position(row.inode, row.offset_bytes) for row in rows
            }

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Ends the thread after the transaction that it is in."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(10.0)

    @property
    def alive(self) -> bool:
        """Whether it follows."""
        return self._thread.is_alive()

    def poll(self) -> int:
        """Takes in what was written since the last call; returns the number of points."""
        with self._lock:
            return sum(self._take_in(run_id) for run_id in self._due())

    def take_in(self, rows: Sequence[RunRow]) -> None:
        """Of these runs now: who sees how far a run is finds its curve as far."""
        try:
            with self._lock:
                for row in rows:
                    self._take_in(row.id)
        except Exception as error:  # who follows tries again
            self._counters.fault("metrics_not_taken_in", "taking in metrics", error)

    def forget(self, run_ids: Collection[str]) -> None:
        """Of runs that are gone: one that comes back is read from its start."""
        with self._lock:
            for run_id in run_ids:
                self._active.pop(run_id, None)
                if self._read.pop(run_id, None) is not None:
                    self._forget(run_id)

    def _forget(self, run_id: str) -> None:
        """What was stored while the run was removed."""
        try:
            with self._database.writing() as session:
                store.forget(session, run_id)
        except OperationalError as error:  # a full disk; it goes with the run's row
            self._counters.fault(
                "curves_not_removed", f"removing the curves of run {run_id}", error
            )

    def _follow(self) -> None:
        while not self._stop.is_set():
            try:
                self.poll()
            except Exception as error:
                # A full disk or a locked database passes; a thread that ended would not come back.
                self._counters.fault("metrics_not_taken_in", "taking in metrics", error)
                self._stop.wait(_AGAIN_S)
            self._stop.wait(POLL_S)

    def _due(self) -> list[str]:
        now_s = time.monotonic()
        self._active = {run: at_s for run, at_s in self._active.items() if now_s - at_s < _ACTIVE_S}
        if now_s < self._scan_at_s:
            return list(self._active)
        found = []
        for name in sorted(os.listdir(self._runs_dir)) if self._runs_dir.exists() else ():
            try:
                status = os.stat(f"{self._runs_dir}/{name}/{_FILE}")
            except OSError:
                continue
            if not _is_read(self._read.get(name), status):
                found.append(name)
        end_s = time.monotonic()
        self._scan_at_s = end_s + max(SCAN_S, (end_s - now_s) / _SCAN_SHARE)
        return found

    def _take_in(self, run_id: str) -> int:
        """What a run's file has that is not stored yet; the number of points."""
        path, points = self._runs_dir / run_id / _FILE, 0
        while not self._stop.is_set():
            try:
                growth = read_on(path, self._read.get(run_id), root=self._runs_dir)
            except OSError as error:  # others' files go on
                self._counters.refuse("metrics_files_refused", str(error))
                break
            if growth.position is None or not (growth.data or growth.is_new):
                break
            points += self._store(run_id, growth, growth.position)
            self._read[run_id] = growth.position
            self._active[run_id] = time.monotonic()
        self._counters.add("points_ingested", points)
        return points

    def _store(self, run_id: str, growth: Growth, position: Position) -> int:
        columns, errors = parse_lines(growth.data)
        for error in errors:
            self._counters.refuse("metrics_lines_refused", f"{run_id}/{_FILE}: {error}")
        with self._database.writing() as session:
            if growth.is_new:
                store.forget(session, run_id)
            if columns:
                store.append(session, run_id, columns)
            inode, offset = position
            session.merge(SourceRow(run_id=run_id, inode=inode, offset_bytes=offset))
        return sum(len(column.steps) for column in columns.values())


def _is_read(position: Position | None, status: os.stat_result) -> bool:
    """Whether a file was read to its end."""
    return position == Position(status.st_ino % 2**63, status.st_size)
