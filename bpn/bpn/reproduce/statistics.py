"""Statistics over seeds and iterations, all pure; seeds are the sample (`bpn_shared.runs.statistics`)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_shared.runs.statistics import merge_seeds

Curves = npt.NDArray[np.float64]
"""float64[seeds, iterations]."""

LAST = 10
"""Iterations at a run's end that count as what it learned."""


def curves(runs: Sequence[dict[str, Any]], name: str) -> Curves:
    """A per-iteration value of several runs' records, a row for each seed: runs of one seed are averaged.

    Shorter runs cut the others to their length.

    Raises:
        ValueError: there are no runs.
    """
    if not runs:
        raise ValueError("no runs: there is nothing to take curves of")
    shortest = min(len(run[name]) for run in runs)
    rows = np.array([run[name][:shortest] for run in runs], np.float64)
    return merge_seeds([run["seed"] for run in runs], rows)


def of_seeds(records: Sequence[dict[str, Any]], values: Sequence[float]) -> npt.NDArray[np.float64]:
    """Values of records, a mean for each of their seeds, float64[seeds]."""
    rows = np.array(values, np.float64)[:, np.newaxis]
    return merge_seeds([record["seed"] for record in records], rows)[:, 0]


def count(runs: Sequence[dict[str, Any]]) -> str:
    """How many seeds the runs have, and how many runs they are if a seed was run more than once."""
    seeds = len({run["seed"] for run in runs})
    return str(seeds) if seeds == len(runs) else f"{seeds} ({len(runs)} runs)"


def full_length_shares(record: dict[str, Any]) -> list[float]:
    """Share of each iteration's episodes that went on to step T: those that did not fail."""
    return [1 - failures / record["episodes"] for failures in record["failures"]]


def at_end(values: Curves, last: int = LAST) -> npt.NDArray[np.float64]:
    """Each seed's mean over its last iterations, float64[seeds]."""
    return np.asarray(values[:, -last:].mean(axis=1), np.float64)


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
