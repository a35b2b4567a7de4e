"""Runs are removed, brought back and deleted for good."""

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from bpn_dashboard.api.configs import Request
from bpn_dashboard.api.context import Admin, Operator, Parts, Viewer
from bpn_dashboard.api.models import RemovedRun, Run
from bpn_dashboard.api.problems import Problem, problem_of, responses
from bpn_dashboard.registry.removals import Tidied
from bpn_dashboard.registry.retention import Rule

router = APIRouter(tags=["trash"])

_MOST = 10**9


class TrashContents(BaseModel):
    """The removed runs, those removed last first."""

    items: list[RemovedRun]


class PruneRule(Request):
    """Which runs to remove; where both are given, those that both mean. At least one must be."""

    keep: Annotated[
        int | None, Field(ge=0, le=_MOST, description="how many of the newest runs stay")
    ] = None
    older_than_days: Annotated[
        float | None,
        Field(ge=0, le=_MOST, description="for how long nothing may have happened to a run"),
    ] = None
    dry_run: Annotated[bool, Field(description="only tell which they would be")] = False


class TidiedRun(BaseModel):
    """What became of one of them."""

    id: str
    name: str
    ok: bool
    problem: Problem | None = None


class TidiedRuns(BaseModel):
    """All of them, oldest first."""

    items: list[TidiedRun]


@router.delete("/runs/{run_id}", operation_id="removeRun", responses=responses(404, 409, 507))
def remove_run(who: Operator, parts: Parts, run_id: str) -> RemovedRun:
    """Moves a run that nobody works on to the trash, from which it can be restored for some days."""
    removed = parts.removals.remove(run_id, who.name)
    return RemovedRun.of(removed, parts.removals.name_of(removed))


@router.post("/runs/prune", operation_id="pruneRuns", responses=responses(409, 422))
def prune_runs(who: Operator, parts: Parts, body: PruneRule) -> TidiedRuns:
    """Moves old runs to the trash, but for those that are queued or learning, and those with the tag `keep`."""
    rule = Rule(keep=body.keep, older_than_days=body.older_than_days)
    return _told(parts.removals.prune(rule, who.name, dry_run=body.dry_run))


@router.get("/trash", operation_id="listTrash")
def list_trash(_who: Viewer, parts: Parts) -> TrashContents:
    """What is in the trash."""
    items = [RemovedRun.of(removed, name) for removed, name in parts.removals.contents()]
    return TrashContents(items=items)


@router.post(
    "/trash/{run_id}/restore", operation_id="restoreRun", responses=responses(404, 409, 422, 507)
)
def restore_run(who: Operator, parts: Parts, run_id: str) -> Run:
    """Brings a run back, as it was."""
    return Run.of(parts.removals.restore(run_id, who.name))


@router.delete(
    "/trash/{run_id}",
    operation_id="deleteRun",
    status_code=204,
    responses=responses(404, 409, 507),
)
def delete_run(who: Admin, parts: Parts, run_id: str) -> Response:
    """Deletes a removed run for good."""
    parts.removals.delete(run_id, who.name)
    return Response(status_code=204)


@router.delete("/trash", operation_id="emptyTrash", responses=responses(409))
def empty_trash(who: Admin, parts: Parts) -> TidiedRuns:
    """Deletes for good all that is in the trash."""
    return _told(parts.removals.empty(who.name))


def _told(done: Sequence[Tidied]) -> TidiedRuns:
    return TidiedRuns(
        items=[
            TidiedRun(
                id=one.run,
                name=one.name,
                ok=one.trouble is None,
                problem=None if one.trouble is None else problem_of(one.trouble),
            )
            for one in done
        ]
    )
