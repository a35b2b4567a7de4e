"""Runs: how many in which state, and of each that is worked on how far it is and what it waits for."""

import time
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from prometheus_client.metrics_core import Metric
from sqlalchemy import func, select

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.exposition.families import gauge
from bpn_dashboard.registry.states import BUSY
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.runs.state import STATES
from bpn_shared.runtime.watchdog import CAUSE_KINDS

MOST_RUNS = 1000
"""That have samples of their own, the newest ones; all are counted."""
_LABELS = ("run", "task")


class _Busy(NamedTuple):
    """A run that may be worked on."""

    id: str
    task: str
    state: str
    iteration: int
    iterations: int
    waiting_reason: str
    waiting_since: float | None

    @property
    def labels(self) -> tuple[str, str]:
        return self.id, self.task


def collect(database: Database, view: RegistryView) -> Iterator[Metric]:
    """The families of runs; those of single runs are of runs that are worked on, and leave with them."""
    now_s = time.time()
    with database.reading() as session:
        counted = select(RunRow.state, func.count()).group_by(RunRow.state)
        counts = {str(state): count for state, count in session.execute(counted)}
        queued = select(func.count(), func.min(RunRow.waiting_since)).where(
            RunRow.state == "queued",
            RunRow.desired_state == "running",
            RunRow.archived_at.is_(None),
        )
        queue, oldest_s = session.execute(queued).one()
        worked_on = (
            select(*(getattr(RunRow, name) for name in _Busy._fields))
            .where(RunRow.state.in_(BUSY), RunRow.archived_at.is_(None))
            .order_by(RunRow.created_at.desc())
            .limit(MOST_RUNS)
        )
        busy = [_Busy(*row) for row in session.execute(worked_on)]
    # with zeros: what rises from nothing shall be seen to rise
    states = [((state,), counts.get(state, 0)) for state in STATES]
    yield gauge("bpn_runs", "Runs by observed state.", ["state"], states)
    yield gauge("bpn_queue_runs", "Runs that wait for a learner.", [], [((), queue)])
    age_s = 0.0 if oldest_s is None else max(0.0, now_s - oldest_s)
    yield gauge(
        "bpn_queue_age_seconds", "For how long the first of them has waited.", [], [((), age_s)]
    )
    waiting = Counter(kind for kinds in view.causes.values() for kind in kinds)
    yield gauge(
        "bpn_runs_waiting", "Runs that make no progress, by kind of reason.", ["reason"],
        [((kind,), waiting[kind]) for kind in CAUSE_KINDS],
    )  # fmt: skip
    yield from _single_runs(busy, view, now_s)


def _single_runs(busy: list[_Busy], view: RegistryView, now_s: float) -> Iterator[Metric]:
    yield gauge(
        "bpn_run_state", "1 for the run's state; lost: it has no learner.", [*_LABELS, "state"],
        [((*run.labels, run.state), 1) for run in busy],
    )  # fmt: skip
    yield gauge(
        "bpn_run_iteration", "Iterations done.", _LABELS, [(r.labels, r.iteration) for r in busy]
    )
    yield gauge(
        "bpn_run_iterations", "Iterations that it shall do.", _LABELS,
        [(run.labels, run.iterations) for run in busy],
    )  # fmt: skip
    yield gauge(
        "bpn_run_iteration_age_seconds",
        "Since the end of its newest iteration, or since its learner began.", _LABELS,
        [
            (run.labels, max(0.0, now_s - at_s))
            for run in busy
            if (at_s := view.advanced_unix_s.get(run.id))
        ],
    )  # fmt: skip
    yield gauge(
        "bpn_run_stalled", "1: the run makes no progress though it shall.", _LABELS,
        [(run.labels, float(run.waiting_reason != "")) for run in busy],
    )  # fmt: skip
    yield gauge(
        "bpn_run_waiting", "1 for every kind of reason why it is stalled.", [*_LABELS, "reason"],
        [
            ((*run.labels, kind), 1)
            for run in busy
            for kind in sorted(view.causes.get(run.id, ()))
        ],
    )  # fmt: skip
    yield gauge(
        "bpn_run_waiting_seconds", "For how long it has been stalled; 0: it is not.", _LABELS,
        [
            (run.labels, 0.0 if (at_s := run.waiting_since) is None else max(0.0, now_s - at_s))
            for run in busy
        ],
    )  # fmt: skip
