"""Curves of groups of runs, from all of their points, in at most so many buckets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from sqlalchemy.orm import Session

from bpn_dashboard.database.series_tables import MetricRow
from bpn_dashboard.series import store
from bpn_dashboard.series.downsample import NO_BUCKETS, Buckets, Floats, bucket_width, bucketize
from bpn_dashboard.series.lines import MAX_ITERATION
from bpn_dashboard.series.points import NO_POINTS, Points
from bpn_dashboard.series.statistics import Band, Curve, Statistic, summarize

Axis = Literal["iteration", "wall_s", "transitions"]

_AXIS_METRIC: Mapping[str, str] = {"wall_s": "time_unix_s", "transitions": "transitions"}
"""The metric that says, at the same iteration, where a point stands on the axis."""


@dataclass(frozen=True)
class View:
    """What is wanted of every series.

    Attributes:
        axis: of x: iterations; seconds since the run's first record; transitions seen so far.
        range: of x, both ends included; None: everything.
        max_points: of a curve.
    """

    axis: Axis = "iteration"
    range: tuple[float, float] | None = None
    max_points: int = 1000
    statistic: Statistic = "mean"
    band: Band = "std"


@dataclass(frozen=True, eq=False)
class Series:
    """One metric of one group.

    Attributes:
        run_ids: the group's runs that have the metric.
        n_points: points that the curve was made of.
        bucket: width of its buckets on the axis; 0: every point stands for itself.
    """

    metric: str
    run_ids: Sequence[str]
    n_points: int
    bucket: float
    curve: Curve


def query(session: Session, run_ids: Sequence[str], metric: str, view: View) -> Series:
    """The curve of a group of runs. The runs' order does not matter, nor does any other group."""
    rows = store.metrics_of(session, sorted(set(run_ids)), [metric])
    if view.axis == "iteration":
        parts, width = _by_iteration(session, rows, view)
    else:
        parts, width = _by_other_axis(session, rows, view)
    return Series(
        metric=metric,
        run_ids=[row.run_id for row, part in zip(rows, parts, strict=True) if len(part.x)],
        n_points=int(sum(part.n.sum() for part in parts)),
        bucket=width,
        curve=summarize(parts, view.statistic, view.band),
    )


def _by_iteration(
    session: Session, rows: Sequence[MetricRow], view: View
) -> tuple[list[Buckets], float]:
    if not rows:
        return [], 0.0
    low, high = float(min(row.first for row in rows)), float(max(row.last for row in rows))
    low, high = _within(low, high, view)
    if low > high:
        return [NO_BUCKETS] * len(rows), 0.0
    ids = [row.id for row in rows]
    begin, end, width = _aligned(low, high, view.max_points)
    if width >= store.ROLLUP:
        rollups = store.read_rollups(session, ids, begin, end)
        if max((part.n.sum() for part in rollups.values()), default=0) > view.max_points:
            return [rollups.get(key, NO_BUCKETS).merge(width) for key in ids], width
    found = store.read_points(session, ids, begin, end)
    parts = [found.get(key, NO_POINTS) for key in ids]
    return _reduce([(part.steps.astype("f8"), part.values) for part in parts], low, high, view)


def _by_other_axis(
    session: Session, rows: Sequence[MetricRow], view: View
) -> tuple[list[Buckets], float]:
    axes = store.metrics_of(session, [row.run_id for row in rows], [_AXIS_METRIC[view.axis]])
    ids = [row.id for row in (*rows, *axes)]
    found = store.read_points(session, ids, 0, MAX_ITERATION)
    axis_of = {row.run_id: found.get(row.id, NO_POINTS) for row in axes}
    parts = [
        _placed(found.get(row.id, NO_POINTS), axis_of.get(row.run_id, NO_POINTS), view.axis)
        for row in rows
    ]
    x = np.concatenate([x for x, _ in parts]) if parts else np.empty(0)
    if not len(x):
        return [NO_BUCKETS] * len(rows), 0.0
    low, high = _within(float(x.min()), float(x.max()), view)
    return _reduce(parts, low, high, view)


def _placed(points: Points, axis: Points, kind: Axis) -> tuple[Floats, Floats]:
    """X and values of the points for whose iteration the axis is known."""
    if not len(axis.steps):
        return np.empty(0), np.empty(0)
    # A clock that was set back must not fold the curve.
    since_start = np.maximum.accumulate(axis.values) - axis.values[0]
    x = np.cumsum(axis.values) if kind == "transitions" else since_start
    at = np.minimum(np.searchsorted(axis.steps, points.steps), len(axis.steps) - 1)
    known = axis.steps[at] == points.steps
    return x[at[known]], points.values[known]


def _within(low: float, high: float, view: View) -> tuple[float, float]:
    if view.range is None:
        return low, high
    return max(low, view.range[0]), min(high, view.range[1])


def _aligned(low: float, high: float, max_points: int) -> tuple[float, float, float]:
    """Begin of the first and end of the last bucket that touch [low, high], and the buckets' width."""
    width = bucket_width(low, high, max_points)
    return low // width * width, float(np.nextafter((high // width + 1) * width, -np.inf)), width


def _reduce(
    parts: Sequence[tuple[Floats, Floats]], low: float, high: float, view: View
) -> tuple[list[Buckets], float]:
    """The points in [low, high] as they are if they stand at few enough x, otherwise whole buckets."""
    shown = [_cut(x, values, low, high) for x, values in parts]
    if len(np.unique(np.concatenate([x for x, _ in shown]))) <= view.max_points:
        return [bucketize(x, values) for x, values in shown], 0.0
    begin, end, width = _aligned(low, high, view.max_points)
    return [bucketize(*_cut(x, values, begin, end), width) for x, values in parts], width


def _cut(x: Floats, values: Floats, low: float, high: float) -> tuple[Floats, Floats]:
    begin, end = np.searchsorted(x, low), np.searchsorted(x, high, side="right")
    return x[begin:end], values[begin:end]
