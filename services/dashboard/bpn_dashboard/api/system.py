"""The system as a whole: who is there, what was done, health."""

from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from sqlalchemy import select

from bpn_dashboard.api.context import Admin, Context, Parts, Viewer
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.certificates import of_workers
from bpn_dashboard.database.tables import AuditRow
from bpn_dashboard.hub.topology import TopologySnapshot
from bpn_shared.version import PROTOCOL, VERSION

router = APIRouter(tags=["system"])
health_router = APIRouter(tags=["health"])


class AuditItem(BaseModel):
    """Something that somebody asked for."""

    id: int
    at_unix_s: float
    actor: str
    action: str
    subject: str
    detail: dict[str, Any]


class AuditPage(BaseModel):
    """Newest first."""

    items: list[AuditItem]
    next_cursor: str | None


class AuditQuery(BaseModel):
    """Which page, and of what run or sweep."""

    model_config = {"extra": "forbid"}

    subject: Annotated[str | None, Field(max_length=100)] = None
    cursor: Annotated[str | None, Field(max_length=1000)] = None
    limit: Annotated[int, Field(ge=1, le=200)] = 50


class UnreadableFolder(BaseModel):
    """A folder that should be a run's, and is not shown, or not wholly."""

    folder: str
    reason: str


class RefusedWorker(BaseModel):
    """A worker that asks for work and cannot be used."""

    kind: str
    id: str
    reason: str


class CertificateStatus(BaseModel):
    """How long a certificate is good."""

    kind: Annotated[str, Field(description="router, web (the pages' address), or of a service")]
    id: Annotated[str, Field(description="of the worker; empty where there is one of the kind")]
    end_unix_s: float
    days_left: Annotated[float, Field(description="below 0: it has expired")]
    near_end: Annotated[bool, Field(description="30 days or the last quarter of its life")]


class SystemStatus(BaseModel):
    """What is wrong with the whole, if anything is."""

    version: str
    protocol: int
    obstacle: Annotated[str | None, Field(description="what keeps workers from being given work")]
    read_only: Annotated[str | None, Field(description="why nothing may be changed here")]
    refused_workers: list[RefusedWorker]
    unreadable_folders: list[UnreadableFolder]
    certificates: Annotated[
        list[CertificateStatus], Field(description="that are known, the first to end first")
    ]


class Health(BaseModel):
    """The server answers."""

    status: str = "ok"


@router.get("/system/topology", operation_id="getTopology")
def get_topology(_who: Viewer, parts: Parts) -> TopologySnapshot:
    """Who is alive, what each waits for, and what flows between them."""
    return parts.topology()


@router.get("/system/status", operation_id="getSystemStatus")
def get_status(_who: Viewer, parts: Parts) -> SystemStatus:
    """What keeps runs from going on or from being shown, apart from the runs themselves."""
    unreadable = parts.runs.index.unreadable()
    return SystemStatus(
        version=VERSION,
        protocol=PROTOCOL,
        obstacle=parts.obstacle(),
        read_only=parts.read_only(),
        refused_workers=[
            RefusedWorker(kind=refused.role, id=refused.worker, reason=refused.reason)
            for refused in parts.refused()
        ],
        unreadable_folders=[
            UnreadableFolder(folder=name, reason=reason) for name, reason in unreadable.items()
        ],
        certificates=_certificates(parts),
    )


def _certificates(parts: Context) -> list[CertificateStatus]:
    now = datetime.now(UTC)
    known = [*parts.certificates(), *of_workers(parts.topology())]
    return [
        CertificateStatus(
            kind=certificate.kind,
            id=certificate.id,
            end_unix_s=certificate.life.end.timestamp(),
            days_left=certificate.days_left(now),
            near_end=certificate.life.is_near_end(now),
        )
        for certificate in sorted(known, key=lambda each: each.life.end)
    ]


@router.get("/audit", operation_id="listAudit", responses=responses(422))
def list_audit(_who: Admin, parts: Parts, query: Annotated[AuditQuery, Query()]) -> AuditPage:
    """Who did what, newest first."""
    scope = ["audit", query.subject]
    wanted = select(AuditRow).order_by(AuditRow.id.desc()).limit(query.limit + 1)
    if query.subject is not None:
        wanted = wanted.where(AuditRow.subject == query.subject)
    if query.cursor is not None:
        wanted = wanted.where(AuditRow.id < parts.cursors.decode(query.cursor, scope))
    with parts.database.reading() as session:
        rows = list(session.scalars(wanted))
    more, rows = len(rows) > query.limit, rows[: query.limit]
    items = [
        AuditItem(
            id=row.id,
            at_unix_s=row.at,
            actor=row.actor,
            action=row.action,
            subject=row.subject,
            detail=row.detail,
        )
        for row in rows
    ]
    following = parts.cursors.encode(rows[-1].id, scope) if more else None
    return AuditPage(items=items, next_cursor=following)


@health_router.get("/healthz", operation_id="getHealth")
def healthz() -> Health:
    """The process answers."""
    return Health()


@health_router.get("/readyz", operation_id="getReadiness", responses=responses(503))
def readyz(parts: Parts) -> Health:
    """The database answers, metrics are taken in, and workers are given work over the bus."""
    parts.series.revision()
    obstacle = parts.obstacle() if parts.ingest.alive else "metrics are not taken in"
    if obstacle is not None:
        raise ApiError(503, "not-ready", obstacle)
    return Health()
