"""What was seen of runs, stored in their rows; where the database takes nothing, kept in memory until it does."""

import logging
import threading
import time
from collections.abc import Iterable, Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import OperationalError

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow

log = logging.getLogger(__name__)

Changes = Mapping[str, Any]
"""Columns of `RunRow` with new values."""


class Observations:
    """Its methods may be called from any thread."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._unwritten: dict[str, dict[str, Any]] = {}
        self._failing = False

    def write(self, observations: Mapping[str, Changes]) -> list[RunRow]:
        """Stores columns by run; returns the rows that have changed, written or not."""
        with self._lock:
            for run_id, seen in observations.items():
                self._unwritten.setdefault(run_id, {}).update(seen)
            try:
                changed = self._write()
            except OperationalError as error:  # a full disk
                if not self._failing:
                    log.warning("what is seen of runs is kept in memory: %s", error.orig)
                self._failing = True
            else:
                self._unwritten, self._failing = {}, False
                return changed
        with self._database.reading() as session:
            seen_rows = select(RunRow).where(RunRow.id.in_(observations))
            rows = list(session.scalars(seen_rows))
        return self.shown(rows)

    def _write(self) -> list[RunRow]:
        with self._database.writing() as session:
            rows = [(session.get(RunRow, run_id), seen) for run_id, seen in self._unwritten.items()]
            return [row for row, seen in rows if row is not None and apply(row, seen)]

    def retry(self) -> None:
        """Writes what could not be written before."""
        if self._unwritten:
            self.write({})

    def shown(self, rows: Iterable[RunRow]) -> list[RunRow]:
        """Rows, detached from the database, as they would be if everything had been written."""
        rows = list(rows)
        if self._unwritten:
            with self._lock:
                for row in rows:
                    apply(row, self._unwritten.get(row.id, {}))
        return rows


def apply(row: RunRow, changes: Changes) -> bool:
    """Whether that changes anything."""
    news = {key: value for key, value in changes.items() if getattr(row, key) != value}
    for key, value in news.items():
        setattr(row, key, value)
    if news:
        row.updated_at = time.time()
    return bool(news)
