"""Runs whose learners die one after the other: trying on would keep the others waiting."""

from dataclasses import dataclass
from uuid import UUID

GIVE_UP_AFTER = 5


@dataclass
class _Deaths:
    iteration: int
    count: int


class CrashLoops:
    """Counts, for each run, the learners that died in a row without finishing an iteration."""

    def __init__(self) -> None:
        self._deaths: dict[UUID, _Deaths] = {}

    def died(self, run: UUID, worker: str, iteration: int) -> str | None:
        """Notes a learner's death.

        Args:
            iteration: how many iterations are done.

        Returns:
            Why the run should be given up; None if it should not.
        """
        deaths = self._deaths.get(run)
        if deaths is None or deaths.iteration != iteration:
            deaths = self._deaths[run] = _Deaths(iteration, 0)
        deaths.count += 1
        if deaths.count < GIVE_UP_AFTER:
            return None
        return (
            f"{deaths.count} learners in a row died in iteration {iteration}, the last was {worker}; "
            "see logs/learner.log and the log of its host (out of memory?). Resume the run to try again"
        )

    def forget(self, run: UUID) -> None:
        """The run is over, or begins anew."""
        self._deaths.pop(run, None)
