"""Curves of groups of runs, from all of their points, in at most so many buckets."""

import threading
from collections import OrderedDict
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy.orm import Session

from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.series_tables import MetricRow
from bpn_dashboard.series import store
from bpn_dashboard.series.axes import METRICS, Axis, place
from bpn_dashboard.series.downsample import NO_BUCKETS, Buckets, Floats, bucket_width, bucketize
from bpn_dashboard.series.lines import MAX_ITERATION
from bpn_dashboard.series.points import NO_POINTS, Points
from bpn_dashboard.series.statistics import Band, Curve, Statistic, summarize
from bpn_dashboard.series.summary import Value, value_of

_REMEMBERED_BYTES = 64 * 1024 * 1024
"""Of curves, however many that are: a page of a hundred lines asks for each again when one has grown."""


@dataclass(frozen=True)
class View:
    """What is wanted of every series.

    Attributes:
        axis: of x, as `series.axes` has them.
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
        seeds: that these runs have: the sample size.
        n_points: points that the curve was made of.
        bucket: width of its buckets on the axis; 0: every point stands for itself.
    """

    metric: str
    run_ids: Sequence[str]
    seeds: int
    n_points: int
    bucket: float
    curve: Curve


class SeriesQueries:
    """Answers queries, from any thread; remembers the newest answers for as long as they are true."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._known: OrderedDict[Hashable, Series] = OrderedDict()
        self._known_bytes = 0

    def query(
        self, groups: Sequence[Mapping[str, int]], metrics: Sequence[str], view: View
    ) -> list[Series]:
        """For every group of runs (id to seed) and every metric the curve, in this order."""
        names = [*metrics, *METRICS[view.axis]]
        with self._database.reading() as session:
            of_all = store.metrics_of(session, sorted({i for ids in groups for i in ids}), names)
            rows = {(row.run_id, row.name): row for row in of_all}
            return [
                self._one(session, rows, seeds, metric, view)
                for seeds in groups
                for metric in metrics
            ]

    def names(self, run_id: str) -> list[tuple[str, int]]:
        """The metrics of a run, with how many points each has."""
        with self._database.reading() as session:
            return [(row.name, row.n) for row in store.metrics_of(session, [run_id])]

    def names_in(self, run_ids: Sequence[str]) -> set[str]:
        """The metrics that any of these runs has."""
        with self._database.reading() as session:
            return {row.name for row in store.metrics_of(session, run_ids)}

    def points(self, run_id: str, metrics: Sequence[str]) -> dict[str, Points]:
        """All points of those of the metrics that the run has."""
        with self._database.reading() as session:
            rows = store.metrics_of(session, [run_id], metrics)
            found = store.read_points(session, [row.id for row in rows], 0, MAX_ITERATION)
        return {row.name: found[row.id] for row in rows if row.id in found}

    def values(self, run_ids: Sequence[str], metric: str, value: Value) -> dict[str, float]:
        """For each run that has the metric, what it came to; runs where that is no number are left out."""
        with self._database.reading() as session:
            rows = store.metrics_of(session, run_ids, [metric])
        found = ((row.run_id, value_of(row, value)) for row in rows)
        return {run_id: number for run_id, number in found if number is not None}

    def table(
        self, run_ids: Sequence[str], columns: Sequence[tuple[str, Value]]
    ) -> dict[str, dict[tuple[str, Value], float]]:
        """For each run what these of its metrics came to; what it does not have is left out."""
        names = sorted({metric for metric, _ in columns})
        with self._database.reading() as session:
            rows = store.metrics_of(session, run_ids, names) if names else []
        found: dict[str, dict[tuple[str, Value], float]] = {run_id: {} for run_id in run_ids}
        for row in rows:
            for metric, value in columns:
                number = value_of(row, value) if metric == row.name else None
                if number is not None:
                    found[row.run_id][metric, value] = number
        return found

    def revision(self) -> int:
        """Grows with every point of any run."""
        with self._database.reading() as session:
            return store.newest_revision(session)

    def _one(
        self,
        session: Session,
        found: Mapping[tuple[str, str], MetricRow],
        seeds: Mapping[str, int],
        metric: str,
        view: View,
    ) -> Series:
        rows = [found[run, metric] for run in sorted(seeds) if (run, metric) in found]
        names = METRICS[view.axis]
        axes = [
            found[row.run_id, name] for row in rows for name in names if (row.run_id, name) in found
        ]
        key = metric, view, tuple((row.id, row.revision) for row in (*rows, *axes))
        with self._lock:
            if (known := self._known.get(key)) is not None:
                self._known.move_to_end(key)
                return known
        series = _series(session, rows, axes, metric, view, seeds=seeds)
        with self._lock:
            self._remember(key, series)
        return series

    def _remember(self, key: Hashable, series: Series) -> None:
        if key in self._known:  # another thread was as quick
            return
        self._known[key] = series
        self._known_bytes += series.curve.size_bytes
        while self._known_bytes > _REMEMBERED_BYTES:
            _, oldest = self._known.popitem(last=False)
            self._known_bytes -= oldest.curve.size_bytes


def _series(
    session: Session,
    rows: Sequence[MetricRow],
    axes: Sequence[MetricRow],
    metric: str,
    view: View,
    *,
    seeds: Mapping[str, int],
) -> Series:
    if view.axis == "iteration":
        parts, width = _by_iteration(session, rows, view)
    else:
        parts, width = _by_other_axis(session, rows, axes, view)
    run_ids = [row.run_id for row, part in zip(rows, parts, strict=True) if part.n.any()]
    return Series(
        metric=metric,
        run_ids=run_ids,
        seeds=len({seeds[run_id] for run_id in run_ids}),
        n_points=int(sum(part.n.sum() for part in parts)),
        bucket=width,
        curve=summarize(parts, [seeds[row.run_id] for row in rows], view.statistic, view.band),
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
    session: Session, rows: Sequence[MetricRow], axes: Sequence[MetricRow], view: View
) -> tuple[list[Buckets], float]:
    ids = [row.id for row in (*rows, *axes)]
    found = store.read_points(session, ids, 0, MAX_ITERATION)
    axes_of: dict[str, dict[str, Points]] = {row.run_id: {} for row in rows}
    for row in axes:
        axes_of[row.run_id][row.name] = found.get(row.id, NO_POINTS)
    parts = [place(found.get(row.id, NO_POINTS), axes_of[row.run_id], view.axis) for row in rows]
    x = np.concatenate([x for x, _ in parts]) if parts else np.empty(0)
    if not len(x):
        return [NO_BUCKETS] * len(rows), 0.0
    low, high = _within(float(x.min()), float(x.max()), view)
    return _reduce(parts, low, high, view)


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
    if _are_few([x for x, _ in shown], view.max_points):
        return [bucketize(x, values) for x, values in shown], 0.0
    begin, end, width = _aligned(low, high, view.max_points)
    return [bucketize(*_cut(x, values, begin, end), width) for x, values in parts], width


def _are_few(xs: Sequence[Floats], most: int) -> bool:
    """Whether all of them together are at most so many different x."""
    longest = max(len(x) for x in xs)
    return longest <= most and len(np.unique(np.concatenate(xs))) <= most


def _cut(x: Floats, values: Floats, low: float, high: float) -> tuple[Floats, Floats]:
    begin, end = np.searchsorted(x, low), np.searchsorted(x, high, side="right")
    return x[begin:end], values[begin:end]
