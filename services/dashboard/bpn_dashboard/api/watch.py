"""What the dashboard saw over time: services, alerts, the environment of attempts."""

import shutil
import time
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from sqlalchemy import func, select

from bpn_dashboard.alerts.rules import Kind
from bpn_dashboard.alerts.watch import shown
from bpn_dashboard.api.context import Parts, Viewer
from bpn_dashboard.api.problems import responses
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.database.watch_tables import AlertRow
from bpn_dashboard.hub.samples import KEPT_S
from bpn_shared.runs.environment import Environment, read_environments

router = APIRouter(tags=["system"])


class Alert(BaseModel):
    """Something that somebody should hear of."""

    id: int
    at_unix_s: float
    kind: Kind
    subject: Annotated[str, Field(description="id of the run or worker that it is about")]
    run: str | None
    text: str


class AlertPage(BaseModel):
    """Newest first."""

    items: list[Alert]
    webhook: Annotated[
        bool, Field(description="they are sent to an address that the operator gave")
    ]
    webhook_trouble: Annotated[
        str, Field(description="why the last one was not sent; empty: it was")
    ]


class ServiceHistory(BaseModel):
    """One service over time; columns are equally long, null where nothing was told."""

    worker: str
    kind: str
    run: str | None
    slot: int | None
    host: str
    at: Annotated[list[int], Field(description="Unix seconds")]
    cpu_percent: list[float | None]
    rss_bytes: list[float | None]
    messages_per_s: list[float | None]
    dropped_per_s: list[float | None]


class SystemHistory(BaseModel):
    """All services that told something since then."""

    services: list[ServiceHistory]


class HistoryQuery(BaseModel):
    """How far back, and how fine."""

    model_config = {"extra": "forbid"}

    seconds: Annotated[float, Field(gt=0, le=KEPT_S)] = 3600.0
    max_points: Annotated[int, Field(ge=10, le=2000)] = 240


class DiskStatus(BaseModel):
    """The disk on which the runs are."""

    total_bytes: int
    free_bytes: int
    runs_bytes: Annotated[int, Field(description="of the runs that were measured")]
    runs_measured: int
    trash_bytes: int


class RunEnvironment(BaseModel):
    """Where and with what a run was made."""

    created: Annotated[dict[str, Any], Field(description="the program that made its folder")]
    attempts: Annotated[list[Environment], Field(description="oldest first")]


@router.get("/alerts", operation_id="listAlerts")
def list_alerts(
    _who: Viewer, parts: Parts, limit: Annotated[int, Query(ge=1, le=200)] = 50
) -> AlertPage:
    """What was worth an alert."""
    with parts.database.reading() as session:
        rows = list(session.scalars(select(AlertRow).order_by(AlertRow.id.desc()).limit(limit)))
    trouble = parts.webhook_trouble()
    return AlertPage(
        items=[Alert(**shown(row)) for row in rows],
        webhook=trouble is not None,
        webhook_trouble=trouble or "",
    )


@router.get("/system/history", operation_id="getSystemHistory", responses=responses(422))
def system_history(
    _who: Viewer, parts: Parts, query: Annotated[HistoryQuery, Query()]
) -> SystemHistory:
    """CPU, memory and messages of every service over the last hours or days."""
    found = parts.samples.read(time.time() - query.seconds, query.max_points)
    return SystemHistory(services=[ServiceHistory(**vars(one)) for one in found])


@router.get("/system/disk", operation_id="getDisk", responses=responses(507))
def disk(_who: Viewer, parts: Parts) -> DiskStatus:
    """How full the disk is, and by what."""
    usage = shutil.disk_usage(parts.runs.runs_dir)
    with parts.database.reading() as session:
        total, measured = session.execute(
            select(func.sum(RunRow.disk_bytes), func.count(RunRow.disk_bytes))
        ).one()
    removed = [one.size_bytes or 0 for one, _ in parts.removals.contents()]
    return DiskStatus(
        total_bytes=usage.total,
        free_bytes=usage.free,
        runs_bytes=int(total or 0),
        runs_measured=measured,
        trash_bytes=sum(removed),
    )


@router.get("/runs/{run_id}/environment", operation_id="getEnvironment", responses=responses(404))
def environment(_who: Viewer, parts: Parts, run_id: str) -> RunEnvironment:
    """Versions, commit, machine and command of every attempt."""
    parts.runs.get(run_id)
    folder = parts.runs.folder(run_id)
    return RunEnvironment(created=folder.written_by(), attempts=read_environments(folder))
