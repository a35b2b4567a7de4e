"""From runs to scores: one for each seed of each group, however often the seed was run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bpn_shared.runs.statistics import Floats, merge_seeds


class ScoredRun(NamedTuple):
    """A run, and what it came to.

    Attributes:
        stratum: what makes scores harder or easier: the task.
        score: None: it has none, or none that is a number.
    """

    id: str
    seed: int
    stratum: str
    score: float | None


@dataclass(frozen=True)
class SeedScore:
    """A seed's score: the mean of its runs'."""

    seed: int
    stratum: str
    score: float
    run_ids: tuple[str, ...]


@dataclass(frozen=True)
class Scores:
    """Of one group.

    Attributes:
        runs: how many it has.
        seeds: those with a score.
        missing: seeds that were run and have none.
    """

    runs: int
    seeds: tuple[SeedScore, ...]
    missing: int

    @classmethod
    def of(cls, runs: Sequence[ScoredRun]) -> "Scores":
        """Seeds in order of stratum and seed."""
        members: dict[tuple[str, int], list[ScoredRun]] = {}
        for run in runs:
            members.setdefault((run.stratum, run.seed), []).append(run)
        seeds = []
        for (stratum, seed), of_one in sorted(members.items()):
            scored = [run for run in of_one if run.score is not None]
            if scored:
                rows = np.array([[run.score] for run in scored], np.float64)
                score = float(merge_seeds([seed] * len(rows), rows)[0, 0])
                run_ids = tuple(sorted(run.id for run in scored))
                seeds.append(SeedScore(seed, stratum, score, run_ids))
        return cls(len(runs), tuple(seeds), len(members) - len(seeds))

    def strata(self) -> dict[str, Floats]:
        """The scores by stratum."""
        found: dict[str, list[float]] = {}
        for one in self.seeds:
            found.setdefault(one.stratum, []).append(one.score)
        return {stratum: np.array(scores) for stratum, scores in found.items()}


def in_common(ones: Mapping[str, Floats], others: Mapping[str, Floats]) -> list[str]:
    """The strata of which both have scores."""
    return [stratum for stratum in ones if stratum in others]
