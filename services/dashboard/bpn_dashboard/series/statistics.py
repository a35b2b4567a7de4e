"""Statistics over the seeds of a group, from all points of all of its runs.

Runs are aligned on the union of their x: between its first and its last point a run that has no value
at an x keeps its newest; outside it is not counted. Runs of one seed are then averaged, since they are one
sample however many they are (`bpn_shared.runs.statistics`), and the result says how many seeds counted (`n`).

Mean, median and interquartile mean (IQM; Agarwal et al. 2021, section 4) are all weighted sums of the sorted
values, and so is each of them in a bootstrap resample. So one matrix product does any of them for all x,
and no result depends on the order of the seeds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Literal

import numpy as np

from bpn_dashboard.series.downsample import Buckets, Floats
from bpn_shared.runs.statistics import iqm_weights, merge_seeds

Statistic = Literal["mean", "median", "iqm"]
Band = Literal["std", "sem", "ci95", "minmax"]

_RESAMPLES = 500
_REST_BYTES = 2000


@dataclass(frozen=True, eq=False)
class Curve:
    """One group's curve; all float64[k]. NaN where there is nothing to tell.

    Attributes:
        x: where the values stand.
        n: seeds that count there.
        value: the statistic over the seeds' means.
        low: the band's lower edge.
        high: the band's upper edge.
        min: the smallest point of any run.
        max: the largest point of any run.
        last: the statistic over the seeds' newest values.
    """

    x: Floats
    n: Floats
    value: Floats
    low: Floats
    high: Floats
    min: Floats
    max: Floats
    last: Floats

    @property
    def size_bytes(self) -> int:
        """Of its columns, and about what the rest takes."""
        return sum(int(getattr(self, field.name).nbytes) for field in fields(self)) + _REST_BYTES


def summarize(
    runs: Sequence[Buckets], seeds: Sequence[int], statistic: Statistic, band: Band
) -> Curve:
    """The curve of a group of runs.

    The standard deviation is the sample's (n - 1), so one seed alone has no band; `sem` is it over the root of n;
    `ci95` is the percentile bootstrap of the statistic; `minmax` spans all points of all runs.

    Args:
        seeds: of each of the runs.
    """
    seeds = [seed for run, seed in zip(runs, seeds, strict=True) if len(run.x)]
    runs = [run for run in runs if len(run.x)]
    x = np.unique(np.concatenate([run.x for run in runs])) if runs else np.empty(0)
    means = np.full((len(runs), len(x)), np.nan)
    lasts, lows, highs = means.copy(), means.copy(), means.copy()
    for row, run in enumerate(runs):
        own = np.searchsorted(x, run.x)
        alive = slice(own[0], own[-1] + 1)
        newest = np.searchsorted(run.x, x[alive], side="right") - 1
        lasts[row, alive] = run.last[newest]
        means[row, alive] = run.last[newest]
        means[row, own] = run.mean
        lows[row, own], highs[row, own] = run.min, run.max
    low, high = _extremes(lows, highs)
    value, edges, n = _over_seeds(merge_seeds(seeds, means), statistic, band)
    last, _, _ = _over_seeds(merge_seeds(seeds, lasts), statistic, None)
    if band == "minmax":
        edges = np.stack([low, high])
    return Curve(x, n, value, edges[0], edges[1], low, high, last)


def _extremes(lows: Floats, highs: Floats) -> tuple[Floats, Floats]:
    if not len(lows):
        return np.empty(0), np.empty(0)
    return np.fmin.reduce(lows), np.fmax.reduce(highs)


def _over_seeds(
    values: Floats, statistic: Statistic, band: Band | None
) -> tuple[Floats, Floats, Floats]:
    """Value float64[k], edges of the band float64[2, k] and n float64[k] of values float64[seeds, k]."""
    ordered = np.sort(values, axis=0)  # what is missing (NaN) comes last
    counts = (~np.isnan(ordered)).sum(axis=0)
    value = np.full(len(counts), np.nan)
    edges = np.full((2, len(counts)), np.nan)
    for n in np.unique(counts[counts > 0]).tolist():
        columns = counts == n
        block = ordered[:n, columns]
        value[columns] = _weights(n, statistic) @ block
        if band in ("std", "sem") and n > 1:
            spread = block.std(axis=0, ddof=1) / (np.sqrt(n) if band == "sem" else 1.0)
            edges[:, columns] = value[columns] - spread, value[columns] + spread
        elif band == "ci95" and n > 1:
            # [k, resamples]: an x's resamples lie side by side in memory, which halves the time
            resampled = block.T @ _resampled_weights(n, statistic).T
            resampled.sort(axis=1)
            edges[:, columns] = _percentile(resampled, 0.025), _percentile(resampled, 0.975)
    return value, edges, counts.astype(np.float64)


def _percentile(ordered: Floats, share: float) -> Floats:
    """Of sorted rows float64[k, n], as `np.percentile`: whose partition takes five times as long as the sort."""
    at = share * (ordered.shape[1] - 1)
    below, above = ordered[:, int(at)], ordered[:, int(at) + 1]
    found: Floats = below + (at - int(at)) * (above - below)
    return found


@cache
def _weights(n: int, statistic: Statistic) -> Floats:
    """float64[n]: what each of n sorted values counts."""
    if statistic == "iqm":
        return iqm_weights(n)
    if statistic == "mean":
        return np.full(n, 1 / n)
    weights = np.zeros(n)
    weights[[(n - 1) // 2, n // 2]] = 1.0
    weights /= weights.sum()
    return weights


@cache
def _resampled_weights(n: int, statistic: Statistic) -> Floats:
    """float64[resamples, n]: what each of n sorted values counts in resamples drawn with replacement.

    A sorted resample of sorted values is those at its sorted indices, so its statistic weighs these.
    """
    drawn = np.random.Generator(np.random.Philox(key=n)).integers(0, n, (_RESAMPLES, n))
    drawn.sort(axis=1)
    weights = np.zeros((_RESAMPLES, n))
    rows = np.arange(_RESAMPLES)[:, None]
    np.add.at(weights, (rows, drawn), _weights(n, statistic)[None, :])
    return weights
