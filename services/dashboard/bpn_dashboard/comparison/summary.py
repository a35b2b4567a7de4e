"""What a comparison says of each of its groups."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bpn_dashboard.comparison.scores import Scores, SeedScore
from bpn_dashboard.comparison.verdicts import Against, against_baseline
from bpn_shared.runs.comparison import (
    Interval,
    Profile,
    iqm_with_interval,
    mean_with_interval,
    performance_profile,
)
from bpn_shared.runs.statistics import Floats, mean_std

_THRESHOLDS = 101
NOTHING = Interval(math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class GroupSummary:
    """Of one group; NaN where there is nothing to tell.

    Attributes:
        std: the sample's, over seeds.
        success: share of successful episodes, over seeds.
        profile: share of seeds that score above each of the comparison's thresholds; None of no seeds.
    """

    scores: Scores
    mean: float
    std: float
    iqm: Interval
    success: Interval
    profile: Profile | None
    against: Against | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Groups compared.

    Attributes:
        thresholds: of the profiles, float64[k], over the range of all scores.
    """

    groups: list[GroupSummary]
    thresholds: Floats


def compare(
    scores: Sequence[Scores],
    successes: Sequence[Scores],
    baseline: int,
    *,
    higher_is_better: bool = True,
) -> Comparison:
    """Compares at least one group.

    Args:
        successes: of the same groups, the shares of successful episodes, where they are defined.
        baseline: which group the others are compared with.
    """
    every = [one.score for group in scores for one in group.seeds]
    thresholds = np.linspace(min(every), max(every), _THRESHOLDS) if every else np.empty(0)
    againsts = against_baseline(list(scores), baseline, higher_is_better=higher_is_better)
    return Comparison(
        [
            _summary(group, _seed_mean(success.seeds), against, thresholds)
            for group, success, against in zip(scores, successes, againsts, strict=True)
        ],
        thresholds,
    )


def _summary(
    group: Scores, success: Interval, against: Against | None, thresholds: Floats
) -> GroupSummary:
    if not group.seeds:
        return GroupSummary(group, math.nan, math.nan, NOTHING, success, None, against)
    strata = list(group.strata().values())
    mean, std = mean_std(one.score for one in group.seeds)
    return GroupSummary(
        group, mean, math.nan if std is None else std, iqm_with_interval(strata), success,
        performance_profile(strata, thresholds), against,
    )  # fmt: skip


def _seed_mean(seeds: Sequence[SeedScore]) -> Interval:
    if not seeds:
        return NOTHING
    return mean_with_interval(list(Scores(0, tuple(seeds), 0).strata().values()))
