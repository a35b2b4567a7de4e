"""Looks at runs and robots now and then, notes what is worth an alert, and has it told."""

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from sqlalchemy import delete, func, select

from bpn_dashboard.alerts.rules import (
    NEWS_S,
    Standing,
    Trouble,
    of_returns,
    of_robots,
    of_runs,
)
from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.database.watch_tables import AlertRow
from bpn_dashboard.hub.topology import TopologySnapshot
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series.query import SeriesQueries

log = logging.getLogger(__name__)

PERIOD_S = 5.0
MOST_KEPT = 1000
_RETURNS_EVERY_S = 30.0
_WORKED_ON = ("running", "stopping", "lost")

Tell = Callable[[Mapping[str, Any]], None]


class AlertWatch:
    """Notes alerts in the database, and tells each to whoever listens.

    Args:
        tell: hears of every new alert; must be quick.
        serving: whether this dashboard serves the router: of two that watch one, that one tells.
    """

    def __init__(
        self,
        database: Database,
        runs: RunStore,
        series: SeriesQueries,
        topology: Callable[[], TopologySnapshot],
        tell: Sequence[Tell],
        *,
        serving: Callable[[], bool] = lambda: True,
    ) -> None:
        self._database, self._runs, self._series = database, runs, series
        self._topology, self._tell, self._serving = topology, tell, serving
        self._standing: Standing | None = None
        self._returns: dict[str, tuple[int, Trouble | None]] = {}  # by run, as of an iteration
        self._returns_at_s = 0.0

    def look(self, now_s: float | None = None) -> list[dict[str, Any]]:
        """The new alerts, which were stored and told."""
        now_s = time.time() if now_s is None else now_s
        rows = self._runs.find(RunFilter(states=_WORKED_ON))
        self._look_at_returns([row for row in rows if row.state == "running"], now_s)
        troubles = [*of_runs(rows, now_s), *self._failed(now_s)]
        troubles += of_robots(self._topology().nodes, rows)
        troubles += [trouble for _, trouble in self._returns.values() if trouble is not None]
        if self._standing is None:
            with self._database.reading() as session:
                told = session.execute(select(AlertRow.kind, AlertRow.subject)).all()
            self._standing = Standing((kind, subject) for kind, subject in told)
        news = self._standing.news(troubles)
        if not self._serving():
            return []
        alerts = self._store(news, now_s)
        for alert in alerts:
            log.warning("alert: %s", alert["text"])
            for tell in self._tell:
                tell(alert)
        return alerts

    def _failed(self, now_s: float) -> list[Trouble]:
        """All runs that failed; of those that did so long ago, and may be many, no more than which they are."""
        failed = RunRow.state == "failed"
        with self._database.reading() as session:
            everyone = session.scalars(select(RunRow.id).where(failed)).all()
            new = session.scalars(select(RunRow).where(failed, RunRow.updated_at > now_s - NEWS_S))
            news = list(of_runs(new, now_s))
        told = {one.subject for one in news}
        return news + [
            Trouble("failed", run, run, "", past=True) for run in everyone if run not in told
        ]

    def _look_at_returns(self, rows: Sequence[RunRow], now_s: float) -> None:
        running = {row.id for row in rows}
        self._returns = {run: seen for run, seen in self._returns.items() if run in running}
        if now_s - self._returns_at_s < _RETURNS_EVERY_S:
            return
        self._returns_at_s = now_s
        for row in rows:
            seen = self._returns.get(row.id)
            if seen is None or seen[0] != row.iteration:
                points = self._series.points(row.id, [row.return_metric]).get(row.return_metric)
                trouble = None if points is None else of_returns(row, points.values)
                self._returns[row.id] = row.iteration, trouble

    def _store(self, news: Sequence[Trouble], now_s: float) -> list[dict[str, Any]]:
        if not news:
            return []
        with self._database.writing() as session:
            rows = [
                AlertRow(at=now_s, kind=one.kind, subject=one.subject, run=one.run, text=one.text)
                for one in news
            ]
            session.add_all(rows)
            session.flush()
            newest = session.scalar(select(func.max(AlertRow.id))) or 0
            session.execute(delete(AlertRow).where(AlertRow.id <= newest - MOST_KEPT))
        return [shown(row) for row in rows]

    def follow(self, stop: threading.Event) -> None:
        """Looks until `stop` is set."""
        while not stop.wait(PERIOD_S):
            try:
                self.look()
            except Exception as error:  # as of a full disk; the next look may do
                log.info("alerts are not looked for now: %s", error)


def shown(row: AlertRow) -> dict[str, Any]:
    """An alert as pages and webhooks get it."""
    return {
        "id": row.id,
        "at_unix_s": row.at,
        "kind": row.kind,
        "subject": row.subject,
        "run": row.run,
        "text": row.text,
    }
