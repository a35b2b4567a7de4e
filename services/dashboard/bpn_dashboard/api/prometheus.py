"""/metrics for Prometheus: what the dashboard counts, and how many runs are in which state."""

from collections.abc import Iterator

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.process_collector import ProcessCollector
from prometheus_client.registry import Collector
from sqlalchemy import func, select

from bpn_dashboard.access.guard import is_loopback
from bpn_dashboard.api.context import Context, Parts, identify
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.database.tables import RunRow
from bpn_shared.runs.state import STATES
from bpn_shared.version import PROTOCOL, VERSION

router = APIRouter(tags=["health"])


class _Dashboard(Collector):
    def __init__(self, parts: Context) -> None:
        self._parts = parts

    def collect(self) -> Iterator[Metric]:
        events = CounterMetricFamily("bpn_dashboard_events", "What was counted.", labels=["event"])
        for name, count in self._parts.counters.snapshot().items():
            events.add_metric([name], count)
        yield events
        runs = GaugeMetricFamily("bpn_runs", "Runs by observed state.", labels=["state"])
        with self._parts.database.reading() as session:
            counted = select(RunRow.state, func.count()).group_by(RunRow.state)
            counts = {str(state): count for state, count in session.execute(counted)}
            waiting = select(RunRow.id, RunRow.task, RunRow.state).where(
                RunRow.waiting_reason != "", RunRow.archived_at.is_(None)
            )
            stalled = [row for row in session.execute(waiting) if row.state != "queued"]
        for state in STATES:  # with zeros: what rises from nothing shall be seen to rise
            runs.add_metric([state], counts.get(state, 0))
        yield runs
        stalls = GaugeMetricFamily(
            "bpn_run_stalled",
            "Runs that make no progress though they shall.",
            labels=["run", "task"],
        )
        for row in stalled:
            stalls.add_metric([row.id, row.task], 1)
        yield stalls
        yield GaugeMetricFamily("bpn_runs_stalled", "How many these are.", len(stalled))
        yield GaugeMetricFamily(
            "bpn_run_folders_unreadable",
            "Folders that should be runs' and cannot be read.",
            len(self._parts.runs.index.unreadable()),
        )
        yield GaugeMetricFamily(
            "bpn_workers_refused",
            "Workers that ask for work and cannot be used.",
            len(self._parts.refused()),
        )
        build = InfoMetricFamily("bpn_build", "The program.", labels=[])
        build.add_metric([], {"version": VERSION, "protocol": str(PROTOCOL)})
        yield build


@router.get(
    "/metrics",
    operation_id="getPrometheusMetrics",
    response_class=Response,
    responses=responses(401, 429)
    | {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def prometheus_metrics(request: Request, parts: Parts) -> Response:
    """Metrics of the dashboard itself, as text."""
    local = request.client is not None and is_loopback(request.client.host)
    if not (parts.open_metrics and local) and identify(request) is None:
        raise ApiError(401, "not-logged-in", "send a token as bearer")
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    registry.register(_Dashboard(parts))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
