"""Mean and spread of what several seeds came to: one definition for every figure, table and page.

The sample size is the number of seeds. Runs of one seed are one draw however often they were made (in lockstep
they are equal bit by bit), so they are averaged first. The spread is the sample's standard deviation (n - 1),
which one seed alone does not have.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Spread:
    """What a value came to over seeds.

    Attributes:
        runs: how many values there were.
        seeds: how many seeds they are of: the sample size.
        mean: over seeds.
        std: the sample's standard deviation over seeds; None of one.
    """

    runs: int
    seeds: int
    mean: float
    std: float | None


def over_seeds(seeds: Sequence[int], values: Sequence[float]) -> Spread:
    """The spread of runs' values, each of the seed at its place.

    Raises:
        ValueError: there are no values, or not as many as seeds.
    """
    samples = merge_seeds(seeds, np.asarray(values, np.float64)[:, np.newaxis])[:, 0]
    mean, std = mean_std(samples)
    return Spread(len(values), len(samples), mean, std)


def merge_seeds(seeds: Sequence[int], rows: Floats) -> Floats:
    """One row for each seed, in order of first appearance: the mean of the seed's rows, float64[seeds, k].

    NaN is a value that a row does not have: it does not count, and where no row of a seed has one, it stays.
    The result does not depend on the order of a seed's rows, to the last bit.

    Raises:
        ValueError: there are not as many rows as seeds.
    """
    if len(seeds) != len(rows):
        raise ValueError(f"{len(rows)} rows of {len(seeds)} seeds")
    places: dict[int, list[int]] = {}
    for place, seed in enumerate(seeds):
        places.setdefault(seed, []).append(place)
    if len(places) == len(rows):
        return rows
    return np.array([_mean_row(rows[of_one]) for of_one in places.values()])


def mean_std(values: Iterable[float]) -> tuple[float, float | None]:
    """Mean and sample standard deviation (n - 1), which a single value does not have.

    Raises:
        ValueError: there are no values.
    """
    array = np.fromiter(values, np.float64)
    if not len(array):
        raise ValueError("no values: there is no mean of nothing")
    return float(array.mean()), float(array.std(ddof=1)) if len(array) > 1 else None


def iqm_weights(n: int) -> Floats:
    """What each of n sorted values counts in their interquartile mean, float64[n].

    The floor(n/4) lowest and highest do not (Agarwal et al. 2021, section 4): of five the middle three count.
    """
    cut = n // 4
    weights = np.zeros(n)
    weights[cut : n - cut] = 1 / (n - 2 * cut)
    return weights


def iqm(values: Iterable[float]) -> float:
    """Interquartile mean: robust to one seed that failed, less noisy than a median.

    Raises:
        ValueError: there are no values.
    """
    ordered = np.sort(np.fromiter(values, np.float64))
    if not len(ordered):
        raise ValueError("no values: the interquartile mean of nothing")
    return float(iqm_weights(len(ordered)) @ ordered)


def _mean_row(rows: Floats) -> Floats:
    ordered = np.sort(rows, axis=0)  # what is missing (NaN) comes last
    counts = (~np.isnan(ordered)).sum(axis=0)
    sums = np.where(np.isnan(ordered), 0.0, ordered).sum(axis=0)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
