"""What a target of `bpn reproduce` is."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from matplotlib.figure import Figure

from bpn.evaluation.trials import TrialPlan
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig


class StoppedError(RuntimeError):
    """The user stopped the making of a target; the message says how far it came."""


Document = dict[str, Any]
"""What a target's JSON file holds; `report.document` describes it."""


@dataclass(frozen=True, slots=True)
class Scope:
    """How much of a target is made.

    Attributes:
        seeds: runs of each configuration.
        first_seed: of the first of them; the others follow it.
        algorithms: those to compare; a target leaves out what it has no use for.
        hidden_units: N of binary networks, where a target compares several; None: all of the target's.
        iterations: of every run; None: the preset's.
        quick: a tiny version through every part, whose numbers mean nothing.
    """

    seeds: int
    algorithms: Sequence[str]
    quick: bool = False
    hidden_units: Sequence[int] | None = None
    iterations: int | None = None
    first_seed: int = 0

    @property
    def each_seed(self) -> range:
        """The seeds of every configuration's runs."""
        return range(self.first_seed, self.first_seed + self.seeds)

    def sizes(self, offered: Sequence[int]) -> list[int]:
        """Those of the target's N that are wanted.

        Raises:
            ConfigError: the target does not have one of them.
        """
        for hidden_units in self.hidden_units or ():
            if hidden_units not in offered:
                raise ConfigError(
                    f"--hidden-units = {hidden_units} is none of {', '.join(map(str, offered))}"
                )
        return [
            hidden_units
            for hidden_units in offered
            if self.hidden_units is None or hidden_units in self.hidden_units
        ]

    def config(self, task: str, **changes: Any) -> RunConfig:
        """The task's preset with these changes; in quick scope a run of seconds."""
        if self.iterations is not None:
            changes["iterations"] = self.iterations
        return RunConfig.for_task(task, **changes | (_QUICK if self.quick else {}))

    def configs(self, task: str) -> list[RunConfig]:
        """The task's preset for every algorithm, one seed after the other."""
        return [
            self.config(task, algorithm=algorithm, seed=seed)
            for seed in self.each_seed
            for algorithm in self.algorithms
        ]


_QUICK = {
    "iterations": 2,
    "episodes": 2,
    "epochs": 1,
    "steps": 12,
    "replay_iterations": 1,
    "hidden_units": 16,
}


class Play(Protocol):
    """Plays trials with the newest weights of a finished run, or recalls them if they were played."""

    def __call__(self, folder: RunFolder, trials: TrialPlan) -> list[Episode]: ...


@dataclass(frozen=True)
class Context:
    """What a target measures with.

    Attributes:
        runs: finished, in the order of the plan.
        play: evaluates one of them.
        say: prints a line about what is being done.
        stop: set when the user interrupts.
    """

    scope: Scope
    runs: Sequence[RunFolder]
    play: Play
    say: Callable[[str], None]
    stop: threading.Event


@dataclass(frozen=True)
class Target:
    """One figure or table of the paper.

    Attributes:
        name: on the command line, and of the files in docs/results.
        title: what it shows, with its place in the paper.
        algorithms: that it compares.
        plan: the runs that it needs, in the order in which they are made.
        measure: what belongs into the document beside the runs' curves, JSON values only.
        draw, table: figure and markdown of a document.
    """

    name: str
    title: str
    algorithms: tuple[str, ...]
    plan: Callable[[Scope], list[RunConfig]]
    measure: Callable[[Context], dict[str, Any]]
    draw: Callable[[Document], Figure]
    table: Callable[[Document], str]
