"""Whether one way of learning is better than another, from few seeds: Agarwal et al. 2021, "Deep RL at the edge of
the statistical precipice".

Scores are those of seeds, one each (`statistics.merge_seeds`), by stratum: a task, or whatever else makes scores
harder or easier. Resamples are drawn within each stratum with replacement (stratified bootstrap), by a generator
with a fixed key, so that an interval is the same whenever and wherever it is asked for.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import numpy.typing as npt

from bpn_shared.runs.statistics import Floats, iqm_weights

RESAMPLES = 2000
_PERMUTATIONS = 9999
_MOST_DRAWN = 8_000_000
"""Values in all resamples together: 64 MB. Of very many seeds fewer resamples do."""
_EXACT_UP_TO = 400
"""Pairs of seeds. Beyond, the normal approximation of Mann and Whitney's test is right to three digits."""

Strata = Sequence[Floats]
"""By stratum its seeds' scores, float64[n] each, all finite and at least one."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % confidence interval; one seed alone has none (NaN)."""

    value: float
    low: float
    high: float


def iqm_with_interval(strata: Strata) -> Interval:
    """Interquartile mean of all scores together, with the percentile interval of the stratified bootstrap.

    Raises:
        ValueError: there are no scores.
    """
    return _interval(strata, _iqm)


def mean_with_interval(strata: Strata) -> Interval:
    """Mean of all scores together, with its interval as above.

    Raises:
        ValueError: there are no scores.
    """
    return _interval(strata, lambda pooled: pooled.mean(axis=-1))


def iqm_difference(ones: Strata, others: Strata) -> Interval:
    """By how much the interquartile mean of `ones` is above that of `others`.

    Raises:
        ValueError: one of the two has no scores.
    """
    upper, lower = _even(_iqm(_resampled(ones, 0)), _iqm(_resampled(others, 1)))
    value = iqm_with_interval(ones).value - iqm_with_interval(others).value
    return _percentiles(value, upper - lower, _sizes(ones) | _sizes(others))


def probability_of_improvement(ones: Strata, others: Strata) -> Interval:
    """How likely a seed of `ones` scores higher than one of `others`, ties counting half: the mean over strata.

    Strata that one of the two lacks are to be left out before.

    Raises:
        ValueError: they have different numbers of strata, none, or one without scores.
    """
    if len(ones) != len(others) or not ones:
        raise ValueError(f"{len(ones)} and {len(others)} strata cannot be compared")
    values, drawn = [], []
    for key, (one, other) in enumerate(zip(ones, others, strict=True)):
        wins = _wins(one, other)
        values.append(float(wins.mean()))
        of_one, of_other = _even(_counts(len(one), 2 * key), _counts(len(other), 2 * key + 1))
        drawn.append(((of_one @ wins) * of_other).sum(axis=1) / wins.size)
    drawn_mean = np.mean(_even(*drawn), axis=0)
    return _percentiles(float(np.mean(values)), drawn_mean, _sizes(ones) | _sizes(others))


def rank_sum_p(one: Floats, other: Floats) -> float:
    """Two-sided p of Mann and Whitney's rank-sum test: how likely so clear an order of seeds is by chance.

    Exact without ties and for few seeds, else by the normal approximation with its corrections for ties and
    continuity. Of three seeds against three it cannot be below 0.1, however far they are apart.

    Raises:
        ValueError: one of the two has no scores.
    """
    if not len(one) or not len(other):
        raise ValueError("no scores: no test of nothing")
    m, n = len(one), len(other)
    u = float(_wins(one, other).sum())
    largest = max(u, m * n - u)
    _, ties = np.unique(np.concatenate([one, other]), return_counts=True)
    if ties.max() == 1 and m * n <= _EXACT_UP_TO:
        counts = _orders(m, n)
        return min(1.0, 2 * sum(counts[round(largest) :]) / math.comb(m + n, m))
    all_ = m + n
    variance = m * n / 12 * (all_ + 1 - float((ties**3 - ties).sum()) / (all_ * (all_ - 1)))
    if variance <= 0:  # all scores are the same
        return 1.0
    z = (largest - m * n / 2 - 0.5) / math.sqrt(variance)
    return min(1.0, math.erfc(z / math.sqrt(2)))


def stratified_p(ones: Strata, others: Strata) -> float:
    """Two-sided p of the probability of improvement over several strata: by permutations within each.

    How likely so large a distance from one half is if, in each stratum, it does not matter which of the two a seed
    belongs to. Of one stratum it is the rank-sum test.

    Raises:
        ValueError: as `probability_of_improvement`.
    """
    if len(ones) == len(others) == 1:
        return rank_sum_p(ones[0], others[0])
    value = probability_of_improvement(ones, others).value
    drawn = []
    for key, (one, other) in enumerate(zip(ones, others, strict=True)):
        both = np.concatenate([one, other])
        of_one = _permuted(len(one), len(other), key)
        won = ((of_one @ _wins(both, both)) * (1.0 - of_one)).sum(axis=1)
        drawn.append(won / (len(one) * len(other)))
    found = np.abs(np.mean(_even(*drawn), axis=0) - 0.5)
    return float((1 + (found >= abs(value - 0.5) - 1e-12).sum()) / (1 + len(found)))


def least_p(m: int, n: int) -> float:
    """The smallest p that so many seeds against so many can come to."""
    return min(1.0, 2 / math.comb(m + n, m))


def holm(ps: Sequence[float]) -> list[float]:
    """The p of several tests as they are if all are to hold together (Holm 1979)."""
    adjusted, largest = [1.0] * len(ps), 0.0
    for rank, place in enumerate(sorted(range(len(ps)), key=ps.__getitem__)):
        largest = max(largest, min(1.0, (len(ps) - rank) * ps[place]))
        adjusted[place] = largest
    return adjusted


@dataclass(frozen=True, eq=False)
class Profile:
    """Of each threshold the share of seeds that score above it, with its 95 % interval; all float64[k]."""

    share: Floats
    low: Floats
    high: Floats


def performance_profile(strata: Strata, thresholds: Floats) -> Profile:
    """The share of scores above each threshold (run-score distribution).

    Raises:
        ValueError: there are no scores.
    """
    _check(strata)
    above = [scores[:, np.newaxis] > thresholds for scores in strata]
    total = sum(map(len, strata))
    share = np.concatenate(above).mean(axis=0)
    drawn = sum(_even(*(_counts(len(part), key) @ part for key, part in enumerate(above)))) / total
    if total < 2:
        return Profile(share, np.full_like(share, np.nan), np.full_like(share, np.nan))
    low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
    return Profile(share, low, high)


def _iqm(pooled: Floats) -> Floats:
    found: Floats = np.sort(pooled, axis=-1) @ iqm_weights(pooled.shape[-1])
    return found


def _interval(strata: Strata, statistic: Callable[[Floats], npt.NDArray[np.float64]]) -> Interval:
    value = float(statistic(np.concatenate(_check(strata))))
    return _percentiles(value, statistic(_resampled(strata)), _sizes(strata))


def _percentiles(value: float, drawn: Floats, sizes: set[int]) -> Interval:
    if max(sizes) < 2:  # nothing to draw from
        return Interval(value, math.nan, math.nan)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return Interval(value, float(low), float(high))


def _check(strata: Strata) -> Strata:
    if not strata or not all(map(len, strata)):
        raise ValueError("no scores: a statistic of nothing")
    return strata


def _sizes(strata: Strata) -> set[int]:
    return {len(scores) for scores in strata}


def _wins(one: Floats, other: Floats) -> Floats:
    """float64[m, n]: 1 where a score of `one` is higher, a half where they are equal."""
    wins: Floats = np.where(one[:, np.newaxis] > other, 1.0, 0.5 * (one[:, np.newaxis] == other))
    return wins


def _resampled(strata: Strata, side: int = 0) -> Floats:
    """float64[resamples, n]: scores drawn anew within each stratum, one stratum after the other."""
    _check(strata)
    rows = [scores[_drawn(len(scores), 2 * key + side)] for key, scores in enumerate(strata)]
    return np.concatenate(_even(*rows), axis=1)


def _even(*drawn: Floats) -> list[Floats]:
    """As many resamples of each: of very many seeds there are fewer."""
    least = min(map(len, drawn))
    return [one[:least] for one in drawn]


@lru_cache(maxsize=64)
def _drawn(n: int, key: int) -> npt.NDArray[np.int64]:
    """int64[resamples, n]: places drawn with replacement; another key draws others."""
    count = max(100, min(RESAMPLES, _MOST_DRAWN // n))
    return np.random.Generator(np.random.Philox(key=[n, key])).integers(0, n, (count, n))


@lru_cache(maxsize=64)
def _counts(n: int, key: int) -> Floats:
    """float64[resamples, n]: how often each place is drawn."""
    drawn = _drawn(n, key)
    counts = np.zeros(drawn.shape)
    np.add.at(counts, (np.arange(len(drawn))[:, np.newaxis], drawn), 1.0)
    return counts


@lru_cache(maxsize=64)
def _permuted(m: int, n: int, key: int) -> Floats:
    """float64[resamples, m + n]: 1 where a seed is taken for one of the m."""
    count = max(100, min(_PERMUTATIONS, _MOST_DRAWN // (m + n)))
    drawn = np.random.Generator(np.random.Philox(key=[m * 2**32 + n, key])).random((count, m + n))
    return (drawn.argsort(axis=1).argsort(axis=1) < m).astype(np.float64)


@cache
def _orders(m: int, n: int) -> tuple[int, ...]:
    """In how many orders of m and n scores the first win u pairs, for u = 0 .. m n."""
    if m == 0 or n == 0:
        return (1,)
    counts = [0] * (m * n + 1)
    for u, count in enumerate(_orders(m - 1, n)):  # the largest is one of the m: it wins n pairs
        counts[u + n] += count
    for u, count in enumerate(_orders(m, n - 1)):
        counts[u] += count
    return tuple(counts)
