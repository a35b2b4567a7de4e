"""/metrics for Prometheus: runs, workers and what they need, as docs/observability.md lists it."""

from collections.abc import Iterator

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.process_collector import ProcessCollector
from prometheus_client.registry import Collector

from bpn_dashboard.api.context import Context, Parts, identify
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.certificates import of_workers
from bpn_dashboard.exposition import runs, system, workers
from bpn_shared.bus.address import is_loopback

router = APIRouter(tags=["health"])


class Families(Collector):
    """Everything but the process itself."""

    def __init__(self, parts: Context) -> None:
        self._parts = parts

    def collect(self) -> Iterator[Metric]:
        """The families as they are now."""
        parts = self._parts
        view, topology = parts.registry(), parts.topology()
        yield from system.program(parts.counters.snapshot())
        yield from system.registry(
            serves=parts.obstacle() is None,
            unreadable_folders=len(parts.runs.index.unreadable()),
        )
        yield from runs.collect(parts.database, view)
        yield from workers.collect(
            topology.nodes, parts.refused(), parts.refusals(), view, parts.counters
        )
        runs_dir = parts.runs.runs_dir
        yield from system.disks({"runs": runs_dir, "state": parts.state_dir or runs_dir})
        yield from system.certificates([*parts.certificates(), *of_workers(topology)])


@router.get(
    "/metrics",
    operation_id="getPrometheusMetrics",
    response_class=Response,
    responses=responses(401, 429)
    | {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def prometheus_metrics(request: Request, parts: Parts) -> Response:
    """Metrics of runs, workers and the dashboard, as text."""
    local = request.client is not None and is_loopback(request.client.host)
    if not (parts.open_metrics and local) and identify(request) is None:
        raise ApiError(401, "not-logged-in", "send a token as bearer")
    registry = CollectorRegistry(auto_describe=False)
    ProcessCollector(registry=registry)
    registry.register(Families(parts))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
