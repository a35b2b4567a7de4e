"""Deaths and give-backs in a row: what comes again and again without an iteration done has to end.

Whoever notes one says how far the run had come when it happened; nothing here is looked up later.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar
from uuid import UUID

from bpn_dashboard.registry.leases import Place

_Key = TypeVar("_Key")

DEATHS = 5
"""Of learners in a row without an iteration done, after which a run is given up."""
GIVE_BACKS = 3
"""Of one place in a row, likewise, once every idle worker has given it back."""
GIVE_BACKS_AT_MOST = 20
"""Whoever else there may be."""
_PAUSE_S, _PAUSE_AT_MOST_S = 2.0, 60.0


class GiveBack(NamedTuple):
    """A worker could not use a place, for a reason, when so many iterations were done."""

    place: Place
    worker: str
    reason: str
    iteration: int


@dataclass
class _Row:
    """What happened in a row while the run stood at one iteration."""

    iteration: int
    count: int = 0
    newest: str = ""
    by_worker: Counter[str] = field(default_factory=Counter)
    not_before_s: dict[str, float] = field(default_factory=dict)


class Setbacks:
    """Counts them for all runs. Times are seconds of any clock that does not jump; not thread-safe."""

    def __init__(self) -> None:
        self._deaths: dict[UUID, _Row] = {}
        self._give_backs: dict[Place, _Row] = {}

    def died(self, run: UUID, worker: str, iteration: int) -> str | None:
        """Notes a learner's death.

        Args:
            iteration: how many iterations were done when it died.

        Returns:
            Why the run should be given up; None if it should not.
        """
        row = _row(self._deaths, run, iteration)
        row.count += 1
        if row.count < DEATHS:
            return None
        return (
            f"{row.count} learners in a row died in iteration {iteration}, the last was {worker}; "
            "see logs/learner.log and the log of its host (out of memory?). Resume the run to try again"
        )

    def gave_back(self, back: GiveBack, idle: set[str], now_s: float) -> str | None:
        """Notes a give-back.

        Args:
            idle: the workers of that role without a place; one that has not tried yet shall try first.

        Returns:
            Why the run should be given up; None if it should not.
        """
        place, worker, reason, iteration = back
        row = _row(self._give_backs, place, iteration)
        row.count += 1
        row.newest = f"{worker} gave it back: {reason}"
        row.by_worker[worker] += 1
        pause_s = min(_PAUSE_S * 2.0 ** (row.by_worker[worker] - 1), _PAUSE_AT_MOST_S)
        row.not_before_s[worker] = now_s + pause_s
        untried = idle - row.by_worker.keys()
        if row.count < GIVE_BACKS or (untried and row.count < GIVE_BACKS_AT_MOST):
            return None
        return (
            f"{place.role} {place.slot} of the run was given back {row.count} times in a row in iteration "
            f"{iteration}, the last time by {worker}: {reason}. Mend that, then resume the run"
        )

    def may_try(self, place: Place, worker: str, now_s: float) -> bool:
        """Whether a place can be offered to a worker, or the worker has just given it back."""
        row = self._give_backs.get(place)
        return row is None or now_s >= row.not_before_s.get(worker, now_s)

    def newest(self, place: Place) -> str:
        """Who gave the place back last, and why; empty if nobody did."""
        row = self._give_backs.get(place)
        return "" if row is None else row.newest

    def served(self, place: Place) -> None:
        """Someone has worked there for long: what went before is no row any more."""
        self._give_backs.pop(place, None)

    def forget(self, run: UUID) -> None:
        """The run is over, or begins anew."""
        self._deaths.pop(run, None)
        for place in [place for place in self._give_backs if place.run == run]:
            del self._give_backs[place]


def _row(rows: dict[_Key, _Row], key: _Key, iteration: int) -> _Row:
    """The row of that iteration; progress ends an earlier one."""
    row = rows.get(key)
    if row is None or row.iteration != iteration:
        row = rows[key] = _Row(iteration)
    return row
