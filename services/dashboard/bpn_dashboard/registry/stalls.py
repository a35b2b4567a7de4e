"""A watchdog for every run that is wanted: since when it makes no progress, and why, as columns of its row."""

import logging
import threading
import time
from typing import Any
from uuid import UUID

from bpn_dashboard.database.tables import RunRow
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runs.state import OVER
from bpn_shared.runtime.watchdog import CauseKind, Circumstances, Watchdog, sentence

log = logging.getLogger(__name__)

NOTHING: dict[str, Any] = {"waiting_reason": "", "waiting_since": None}


class Stalls:
    """Belongs to one thread, but for `hear` and `kinds`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inbox: dict[str, tuple[Telemetry, float]] = {}
        self._run_of: dict[str, str | None] = {}
        self._watchdogs: dict[str, Watchdog] = {}
        self._queued: set[str] = set()
        self._since_unix_s: dict[str, float] = {}
        self._logged: set[str] = set()
        self._kinds: dict[str, frozenset[CauseKind]] = {}

    def hear(self, report: Telemetry) -> None:
        """A service tells how it is. May be called on any thread."""
        with self._lock:
            self._inbox[report.worker] = report, time.monotonic()

    def read(self) -> None:
        """Takes in what was heard."""
        with self._lock:
            inbox, self._inbox = self._inbox, {}
        for worker, (report, at_s) in inbox.items():
            before = self._run_of.get(worker)
            self._run_of[worker] = report.run
            if before != report.run and before in self._watchdogs:
                self._watchdogs[before].gone(worker)
            if report.run in self._watchdogs:
                self._watchdogs[report.run].hear(report, at_s)

    def workers(self) -> set[str]:
        """Who was heard of and did not go."""
        return set(self._run_of)

    def gone(self, worker: str) -> None:
        """A worker works nowhere any more."""
        run = self._run_of.pop(worker, None)
        if run in self._watchdogs:
            self._watchdogs[run].gone(worker)

    def silent_s(self, run: UUID, worker: str, now_s: float) -> float | None:
        """How long ago a run's worker last reported; None: it never did."""
        watchdog = self._watchdogs.get(str(run))
        return None if watchdog is None else watchdog.silent_s(worker, now_s)

    def columns(self, row: RunRow, around: Circumstances, now_s: float) -> dict[str, Any]:
        """The columns of a run's row that say what it waits for."""
        if row.desired_state != "running" or row.state in OVER or row.archived_at is not None:
            self.forget(row.id)
            return NOTHING
        if row.id not in self._watchdogs:
            self._watchdogs[row.id] = Watchdog(int(row.config["steps"]), now_s)
        watchdog = self._watchdogs[row.id]
        watchdog.iterated(row.iteration, now_s)
        if row.state == "queued":
            self._queued.add(row.id)
        elif row.id in self._queued:
            self._queued.remove(row.id)
            watchdog.begin(now_s)
            self._ends(row.id)
        stall = watchdog.stall(now_s, around)
        if stall is None and row.state != "queued":
            self._ends(row.id)
            return NOTHING
        causes = watchdog.causes(now_s, around) if stall is None else stall.causes
        with self._lock:
            self._kinds[row.id] = frozenset(cause.kind for cause in causes)
        reason = sentence(causes)
        for_s = 0.0 if stall is None else stall.for_s
        since = self._since_unix_s.setdefault(row.id, time.time() - for_s)
        if stall is not None and row.id not in self._logged and "before it" not in reason:
            self._logged.add(row.id)
            log.warning("run %s has made no progress for %.0f s: %s", row.id, for_s, reason)
        return {"waiting_reason": reason, "waiting_since": since}

    def kinds(self) -> dict[str, frozenset[CauseKind]]:
        """Why the runs that wait do so. May be called on any thread."""
        with self._lock:
            return dict(self._kinds)

    def _ends(self, run_id: str) -> None:
        with self._lock:
            self._kinds.pop(run_id, None)
        since = self._since_unix_s.pop(run_id, None)
        if run_id in self._logged and since is not None:
            self._logged.remove(run_id)
            log.info("run %s goes on after %.0f s", run_id, max(0.0, time.time() - since))

    def forget(self, run_id: str) -> None:
        """The run is over, or nobody wants it now."""
        self._watchdogs.pop(run_id, None)
        with self._lock:
            self._kinds.pop(run_id, None)
        self._queued.discard(run_id)
        self._since_unix_s.pop(run_id, None)
        self._logged.discard(run_id)
