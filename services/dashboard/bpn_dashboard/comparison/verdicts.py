"""Whether a group is better than the baseline, and how that is said.

Something is called better or worse where the rank-sum test says so at 5 %, after Holm's correction for all groups
that are compared with the same baseline. Few seeds can never say so, however far apart they are: then the sentence
says that more are needed.
"""

from dataclasses import dataclass
from typing import Literal

from bpn_dashboard.comparison.scores import Scores, in_common
from bpn_shared.runs.comparison import (
    Interval,
    holm,
    iqm_difference,
    least_p,
    probability_of_improvement,
    stratified_p,
)

Verdict = Literal["better", "worse", "unclear", "too few seeds"]
LEVEL = 0.05


@dataclass(frozen=True)
class Against:
    """A group beside the baseline.

    Attributes:
        difference: of interquartile means, this one's less the baseline's.
        improvement: how likely one of its seeds is better than one of the baseline's.
        p: of the rank-sum test, corrected.
    """

    difference: Interval
    improvement: Interval
    p: float
    verdict: Verdict


def against_baseline(
    groups: list[Scores], baseline: int, *, higher_is_better: bool
) -> list[Against | None]:
    """Every group against the one at place `baseline`; None: that one itself, or nothing to compare."""
    found: list[tuple[int, Interval, Interval, float, float]] = []
    of_baseline = groups[baseline].strata()
    for place, group in enumerate(groups):
        own = group.strata()
        strata = [] if place == baseline else in_common(own, of_baseline)
        if not strata:
            continue
        sign = 1.0 if higher_is_better else -1.0
        ones = [sign * own[one] for one in strata]
        others = [sign * of_baseline[one] for one in strata]
        difference = iqm_difference(
            [own[one] for one in strata], [of_baseline[one] for one in strata]
        )
        improvement = probability_of_improvement(ones, others)
        p = stratified_p(ones, others)
        least = least_p(sum(map(len, ones)), sum(map(len, others)))
        found.append((place, difference, improvement, p, least))
    corrected = holm([p for *_, p, _ in found])
    result: list[Against | None] = [None] * len(groups)
    for (place, difference, improvement, _, least), p in zip(found, corrected, strict=True):
        verdict = _verdict(improvement.value, p, least * len(found))
        result[place] = Against(difference, improvement, p, verdict)
    return result


def _verdict(improvement: float, p: float, least: float) -> Verdict:
    if p < LEVEL:
        return "better" if improvement > 0.5 else "worse"
    return "too few seeds" if least >= LEVEL else "unclear"


def enough_seeds(tests: int) -> int:
    """Of each of two groups, so that so many tests could say something at all."""
    n = 1
    while tests * least_p(n, n) >= LEVEL:
        n += 1
    return n


def sentence(
    group: str, baseline: str, against: Against, *, measure: str, sizes: tuple[int, int], tests: int
) -> str:
    """A conclusion in one sentence, of the group's and the baseline's names.

    Args:
        measure: what was compared, in words.
        sizes: how many seeds the group and the baseline have.
        tests: how many groups are compared with this baseline.
    """
    seeds = f"{sizes[0]} seeds" if sizes[0] == sizes[1] else f"{sizes[0]} and {sizes[1]} seeds"
    if sizes == (1, 1):
        seeds = "one seed each"
    elif sizes[0] == sizes[1]:
        seeds += " each"
    better = f"{round(100 * against.improvement.value)} % of the pairs of seeds"
    facts = f"it wins {better}, p = {_p(against.p)}, {seeds}"
    match against.verdict:
        case "better":
            return f"{group} is better than {baseline} in {measure}: {facts}."
        case "worse":
            return f"{group} is worse than {baseline} in {measure}: {facts}."
        case "unclear":
            return f"No difference between {group} and {baseline} in {measure} is shown: {facts}."
    ahead = "ahead of" if against.improvement.value > 0.5 else "behind"
    if against.improvement.value == 0.5:
        ahead = "level with"
    return (
        f"{group} is {ahead} {baseline} in {measure} so far ({facts}), but so few seeds cannot show a difference: "
        f"run at least {enough_seeds(tests)} of each."
    )


def _p(p: float) -> str:
    return "below 0.001" if p < 0.001 else f"{p:.2g}"
