"""The runs that wait for workers: in which order they are served, and how that is changed."""

from collections.abc import Sequence
from typing import Literal

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.errors import RunStateError
from bpn_dashboard.registry.observations import Changes
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.store import RunStore

_WAITING = ("queued", "lost")
End = Literal["front", "back"]


def queue_order(row: RunRow) -> tuple[int, float, str]:
    """What runs are sorted by that are to be served first first."""
    return -row.priority, row.created_at, row.id


def queue(store: RunStore) -> list[RunRow]:
    """The runs that wait for a learner, those served first first."""
    waiting = store.find(RunFilter(states=_WAITING))
    return sorted((row for row in waiting if row.desired_state == "running"), key=queue_order)


def move(store: RunStore, run_ids: Sequence[str], end: End, actor: str) -> None:
    """Puts waiting runs before or behind all others, in the order that they have among each other.

    Raises:
        UnknownRunError: there is none of an id; those before it are moved.
        RunStateError: one of them does not wait.
    """
    priorities = [row.priority for row in queue(store) if row.id not in run_ids] or [0]
    priority = max(priorities) + 1 if end == "front" else min(priorities) - 1

    def decide(row: RunRow) -> Changes:
        if row.state not in _WAITING:
            raise RunStateError(f"run {row.id} is {row.state}: it does not wait for workers")
        return {"priority": priority}

    for run_id in run_ids:
        store.edit(run_id, "move", actor, decide)
