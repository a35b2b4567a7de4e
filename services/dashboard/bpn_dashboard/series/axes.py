"""Where a run's points stand on other axes than that of iterations."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from bpn_dashboard.series.downsample import Floats
from bpn_dashboard.series.points import NO_POINTS, Points

Axis = Literal["iteration", "process_s", "wall_s", "transitions"]
"""Iterations; seconds that the run was worked on, without pauses; seconds since its start, by the clock;
transitions seen so far."""

_DURATION = "iteration_s"
METRICS: Mapping[Axis, tuple[str, ...]] = {
    "iteration": (),
    "process_s": (_DURATION,),
    "wall_s": ("time_unix_s", _DURATION),
    "transitions": ("transitions",),
}
"""The metrics that say, at the same iteration, where a point stands; the first of them has to be there."""


def place(points: Points, found: Mapping[str, Points], axis: Axis) -> tuple[Floats, Floats]:
    """X float64[k], ascending, and values float64[k] of the points for whose iteration the axis is known.

    Args:
        found: by name, those of the axis' metrics that the run has.
    """
    of_axis = _numbers(found.get(METRICS[axis][0], NO_POINTS))
    if not len(of_axis.steps):
        return np.empty(0), np.empty(0)
    if axis == "wall_s":
        x = _since_start(of_axis, _numbers(found.get(_DURATION, NO_POINTS)))
    else:
        x = np.cumsum(of_axis.values)
    at, known = _same_steps(of_axis, points)
    return x[at], points.values[known]


def _since_start(times: Points, durations: Points) -> Floats:
    """Seconds since the start of the first iteration, when each ended.

    A clock that was set back says nothing of the iteration meanwhile: it took as long as it says itself.
    """
    took_s = np.zeros(len(times.steps))
    at, known = _same_steps(durations, times)
    took_s[known] = durations.values[at]
    passed_s = np.diff(times.values, prepend=times.values[0] - took_s[0])
    return np.cumsum(np.where(passed_s < 0, np.maximum(took_s, 0.0), passed_s))


def _numbers(points: Points) -> Points:
    finite = np.isfinite(points.values)
    return Points(points.steps[finite], points.values[finite])


def _same_steps(source: Points, wanted: Points) -> tuple[np.ndarray, np.ndarray]:
    """Where in `source` the steps of `wanted` stand that it has, and bool[n] which of `wanted` these are."""
    if not len(source.steps):
        return np.empty(0, np.int64), np.zeros(len(wanted.steps), bool)
    at = np.minimum(np.searchsorted(source.steps, wanted.steps), len(source.steps) - 1)
    known = source.steps[at] == wanted.steps
    return at[known], known
