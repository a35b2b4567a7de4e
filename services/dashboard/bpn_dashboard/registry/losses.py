"""Learners whose token went while their run was not over: did they die, and how far had the run come?

How far is noted when the token goes, before the place is given to another learner, who would bring the run on.
Whether the worker died shows a little later: one that gave the run back lives, and asks for work.
"""

from dataclasses import dataclass
from uuid import UUID

SURELY_DEAD_S = 1.0
"""After a learner's lease has gone: whether it gave it back or died is then known."""


@dataclass
class Loss:
    """A learner whose token went.

    Attributes:
        iteration: how many iterations were done then; None: not noted yet.
        gave_back: it was heard of since.
    """

    run: UUID
    worker: str
    at_s: float
    iteration: int | None = None
    gave_back: bool = False


class Losses:
    """Those of all runs. Times are seconds of any clock that does not jump; not thread-safe."""

    def __init__(self) -> None:
        self._losses: list[Loss] = []

    def lost(self, run: UUID, worker: str, now_s: float) -> None:
        """A learner's token went."""
        self._losses.append(Loss(run, worker, now_s))

    def heard_of(self, worker: str) -> None:
        """A worker asks for work: what it had, it gave back."""
        for loss in self._losses:
            loss.gave_back |= loss.worker == worker

    def unnoted(self) -> list[Loss]:
        """Those of which it is not noted how far the run had come."""
        return [loss for loss in self._losses if loss.iteration is None]

    def is_unnoted(self, run: UUID) -> bool:
        """Whether the run has to stay as it is until it is noted how far it came."""
        return any(loss.run == run for loss in self.unnoted())

    def drop(self, loss: Loss) -> None:
        """It was none: the run was over, or was to stop."""
        if loss in self._losses:
            self._losses.remove(loss)

    def deaths(self, now_s: float, alive: set[str]) -> list[Loss]:
        """The losses that were deaths, each told once, in order."""
        due = [
            loss
            for loss in self._losses
            if loss.iteration is not None and now_s - loss.at_s > SURELY_DEAD_S
        ]
        self._losses = [loss for loss in self._losses if loss not in due]
        return [loss for loss in due if not loss.gave_back and loss.worker not in alive]

    def clear(self) -> None:
        """It was the router that they lost."""
        self._losses.clear()
