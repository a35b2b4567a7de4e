"""What waits for workers, why, and in which order; and what a new run would have to wait for."""

from collections import Counter
from typing import Annotated, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from bpn_dashboard.api.configs import Request as Body
from bpn_dashboard.api.configs import RunChanges
from bpn_dashboard.api.context import Context, Operator, Parts, Viewer
from bpn_dashboard.api.models import MAX_IDS, Run, RunId
from bpn_dashboard.api.problems import responses
from bpn_dashboard.registry.queue import move, queue
from bpn_shared.runs.creation import configure

router = APIRouter(tags=["queue"])

_SHOWN = 200


class QueueShown(BaseModel):
    """The runs that wait for a learner, those served first first; at most 200 of them."""

    total: int
    learners: Annotated[int, Field(description="connected")]
    items: list[Run]


class QueueMove(Body):
    """Runs to serve before, or after, all others that wait."""

    ids: Annotated[list[RunId], Field(min_length=1, max_length=MAX_IDS)]
    to: Literal["front", "back"]


class RunChecked(BaseModel):
    """A configuration that a run can have, and what it would wait for."""

    notices: Annotated[list[str], Field(description="what keeps it from beginning at once")]


@router.get("/queue", operation_id="getQueue")
def get_queue(_who: Viewer, parts: Parts) -> QueueShown:
    """What waits, and why."""
    return _queue(parts)


@router.post("/queue/move", operation_id="moveInQueue", responses=responses(404, 409, 422, 507))
def move_in_queue(who: Operator, parts: Parts, body: QueueMove) -> QueueShown:
    """Changes the order in which waiting runs are served; who works already is left alone."""
    move(parts.runs, body.ids, body.to, who.name)
    return _queue(parts)


@router.post("/runs/check", operation_id="checkRun", responses=responses(422))
def check_run(_who: Operator, parts: Parts, body: RunChanges) -> RunChecked:
    """Refuses what creating the run would refuse, and tells what it would wait for; makes nothing."""
    config = configure(body.model_dump(exclude_unset=True), parts.place)
    obstacle = parts.obstacle()
    notices = [obstacle] if obstacle else []
    connected = _connected(parts)
    for kind, needed in (
        ("learner", config.learners),
        ("robot_sim", config.robots),
        ("edge", config.robots),
    ):
        there, name = connected[kind], kind.removesuffix("_sim")
        if there < needed:
            notices.append(
                f"It needs {needed} {name}{'s' if needed > 1 else ''}, and {there or 'none'} "
                f"{'are' if there > 1 else 'is'} connected: it waits until there are enough."
            )
    waiting = len(queue(parts.runs))
    if waiting:
        notices.append(f"{waiting} {'runs wait' if waiting > 1 else 'run waits'} before it.")
    return RunChecked(notices=notices)


def _connected(parts: Context) -> Counter[str]:
    return Counter(node.kind for node in parts.topology().nodes if node.state == "live")


def _queue(parts: Context) -> QueueShown:
    rows = queue(parts.runs)
    return QueueShown(
        total=len(rows),
        learners=_connected(parts)["learner"],
        items=[Run.of(row) for row in rows[:_SHOWN]],
    )
