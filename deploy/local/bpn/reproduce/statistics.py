"""Statistics over seeds and iterations, all pure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Curves = npt.NDArray[np.float64]
"""float64[seeds, iterations]."""

LAST = 10
"""Iterations at a run's end that count as what it learned."""


def curves(runs: Sequence[dict[str, Any]], name: str) -> Curves:
    """A per-iteration value of several runs' records; shorter runs cut the others to their length.

    Raises:
        ValueError: there are no runs.
    """
    if not runs:
        raise ValueError("no runs: there is nothing to take curves of")
    shortest = min(len(run[name]) for run in runs)
    return np.array([run[name][:shortest] for run in runs], np.float64)


def full_length_shares(record: dict[str, Any]) -> list[float]:
    """Share of each iteration's episodes that went on to step T: those that did not fail."""
    return [1 - failures / record["episodes"] for failures in record["failures"]]


def at_end(values: Curves, last: int = LAST) -> npt.NDArray[np.float64]:
    """Each seed's mean over its last iterations, float64[seeds]."""
    return np.asarray(values[:, -last:].mean(axis=1), np.float64)


def mean_std(values: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Mean and population standard deviation."""
    return float(values.mean()), float(values.std())


def iqm(values: npt.NDArray[np.float64]) -> float:
    """Interquartile mean: of what is left without the floor(n/4) lowest and highest.

    With five seeds the mean of the middle three. Robust to one seed that failed, less noisy than a median.

    Raises:
        ValueError: there are no values.
    """
    if len(values) == 0:
        raise ValueError("no values: the interquartile mean of nothing")
    cut = len(values) // 4
    return float(np.sort(values)[cut : len(values) - cut].mean())


def shortfall_percent(value: float, best: float) -> float:
    """How much worse a return is than another one, in percent of it; negative where it is better."""
    return 100 * (best - value) / abs(best)


def group(
    runs: Sequence[dict[str, Any]], *keys: str
) -> dict[tuple[Any, ...], list[dict[str, Any]]]:
    """The records by the values that they have under these keys, in order of appearance."""
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for run in runs:
        groups.setdefault(tuple(run[key] for key in keys), []).append(run)
    return groups
