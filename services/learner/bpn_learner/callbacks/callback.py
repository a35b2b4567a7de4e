"""What a callback of training is: an entry point of the group `bpn.callbacks`, docs/own-callback.md.

The learner of rank 0 makes those that the configuration names, once an attempt, in `RunConfig.callback_names`'
order, and calls all of them on the thread that trains, in that order: training waits meanwhile. What one raises is
logged and counted (`callbacks_failed`), and neither ends the training nor keeps the others from being called. What
they are given is theirs: changing it changes nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.config import RunConfig


@dataclass(frozen=True, slots=True)
class CollectionEnd:
    """All episodes of an iteration are there.

    Attributes:
        returns: of each episode, unscaled.
        lengths: steps of each episode.
    """

    iteration: int
    returns: tuple[float, ...]
    lengths: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class UpdateEnd:
    """A policy update is done, and edges have its weights.

    Attributes:
        record: the iteration's metrics (docs/metrics.md), with what callbacks before this one have added; it is
            written once all have been called.
        weights: version iteration + 1.
    """

    iteration: int
    record: Mapping[str, object]
    weights: Weights


@dataclass(frozen=True, slots=True)
class EvaluationEnd:
    """An evaluation is done.

    Attributes:
        version: of the weights that were played greedily.
        returns: of each episode, unscaled.
        successes: as the task defines it; None where nobody does.
    """

    iteration: int
    version: int
    returns: tuple[float, ...]
    successes: tuple[bool | None, ...]


@dataclass(frozen=True, slots=True)
class RunEnd:
    """This attempt is over.

    Attributes:
        finished: whether the run is; otherwise it was stopped or has failed, and may be resumed.
        reason: why it finished before its last iteration; "" otherwise.
    """

    finished: bool
    reason: str


class TrainingRun(Protocol):
    """What a callback knows of the run, and can ask of it."""

    @property
    def config(self) -> RunConfig:
        """The run's configuration."""
        ...

    @property
    def folder(self) -> Path:
        """The run folder. A callback reads what it likes, and writes into a folder of its own in it."""
        ...

    @property
    def first(self) -> int:
        """The iteration that this attempt goes on with."""
        ...

    @property
    def records(self) -> tuple[Mapping[str, object], ...]:
        """Metrics of the iterations before it."""
        ...

    def add(self, name: str, value: float) -> None:
        """Adds a number to the iteration's metrics, during `on_update_end`; what is there already stays.

        Raises:
            RuntimeError: not during `on_update_end`.
            ValueError: the name is taken, or none of letters, digits, `_` and `.`; the number is not finite; or an
                attempt's callbacks add more than 100 names.
        """
        ...

    def evaluate(self, episodes: int) -> EvaluationEnd | None:
        """Lets the robots play the newest weights greedily, during `on_update_end`; tells all callbacks.

        The seeds of these episodes are their own, the same ones at each evaluation, and nothing is learned from
        them. None: the learner is being stopped.

        Raises:
            ValueError: no episode is asked for.
            RuntimeError: they cannot be played, or not now.
            InputError: the rewards of one cannot be told.
            OwnershipLostError: another learner has taken the run over.
        """
        ...

    def keep_best(self, version: int, metric: str, value: float) -> None:
        """Notes in the run folder that no policy was better than this version (`bpn eval --best`).

        Raises:
            ValueError: the version or the value is none.
            OSError: the disk does not take it.
        """
        ...

    def stop(self, reason: str) -> None:
        """Lets the run finish once the iteration is; the first reason counts, in one line.

        Raises:
            ValueError: there is no reason.
        """
        ...


class Callback:
    """The base of callbacks: each method is called at its time, and does nothing.

    The entry point is such a class, or a function with the same argument that returns one. What it raises then is
    said at the beginning of the run, which fails.
    """

    def __init__(self, run: TrainingRun) -> None:
        self.run = run

    def on_collection_end(self, end: CollectionEnd) -> None:
        """All episodes of an iteration are there; the update follows."""

    def on_update_end(self, end: UpdateEnd) -> None:
        """A policy update is done; its metrics are about to be written."""

    def on_evaluation_end(self, end: EvaluationEnd) -> None:
        """Greedy episodes were played."""

    def on_run_end(self, end: RunEnd) -> None:
        """The attempt is over; nothing is called after it."""
