"""How large the runs' folders are: measured one after the other, in a small share of the time."""

import logging
import threading
import time
from pathlib import Path

from sqlalchemy import select, update
from sqlalchemy.exc import OperationalError

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow
from bpn_shared.runs.opening import size_bytes

log = logging.getLogger(__name__)

EVERY_S = 60.0
_SHARE = 0.05
"""Of the time that measuring may take, however many files there are."""


class DiskUsage:
    """Measures the runs that changed since they were last measured."""

    def __init__(self, database: Database, runs_dir: Path) -> None:
        self._database, self._runs_dir = database, runs_dir
        self._measured_s: dict[str, float] = {}  # by run, when its row had changed then

    def due(self) -> list[tuple[str, float]]:
        """The runs to measure, those that changed last first, and when they changed."""
        wanted = select(RunRow.id, RunRow.updated_at, RunRow.disk_bytes)
        with self._database.reading() as session:
            rows = list(session.execute(wanted.order_by(RunRow.updated_at.desc())))
        first = not self._measured_s
        if first:  # of what is known from before it is believed that it stayed so
            self._measured_s = {run: at_s for run, at_s, size in rows if size is not None}
        known = {run for run, _, _ in rows}
        self._measured_s = {run: s for run, s in self._measured_s.items() if run in known}
        return [(run, at_s) for run, at_s, _ in rows if self._measured_s.get(run) != at_s]

    def measure(self, run_id: str, changed_s: float) -> int | None:
        """The size of a run's folder, which is stored; None: it cannot be told, as of one that went just now."""
        self._measured_s[run_id] = changed_s
        try:
            size = size_bytes(self._runs_dir, run_id)
            with (
                self._database.writing() as session
            ):  # not as a change of the run: nothing happened to it
                session.execute(update(RunRow).where(RunRow.id == run_id).values(disk_bytes=size))
        except (OSError, OperationalError) as error:
            log.debug("the size of run %s is not known: %s", run_id, error)
            return None
        return size

    def follow(self, stop: threading.Event) -> None:
        """Measures now and then until `stop` is set."""
        while not stop.wait(min(EVERY_S, 5.0) if not self._measured_s else EVERY_S):
            try:
                for run_id, changed_s in self.due():
                    begin_s = time.monotonic()
                    self.measure(run_id, changed_s)
                    if stop.wait((time.monotonic() - begin_s) / _SHARE):
                        return
            except Exception as error:  # as of a locked database; the next time may do
                log.info("the sizes of runs are not measured now: %s", error)
