"""What a series came to, in one number.

It is kept beside each metric, so that tables sort by it without reading points.
"""

import math
from typing import Any, Literal, get_args

import numpy as np
from sqlalchemy.orm import InstrumentedAttribute

from bpn_dashboard.database.series_tables import MetricRow
from bpn_dashboard.series.downsample import Floats

Value = Literal["last", "highest", "lowest", "mean_5", "mean_20", "mean_100"]
"""The newest, the extremes of all, or the mean of so many newest points."""
VALUES: tuple[Value, ...] = get_args(Value)
COLUMNS: dict[Value, InstrumentedAttribute[Any]] = {
    "last": MetricRow.newest,
    "highest": MetricRow.highest,
    "lowest": MetricRow.lowest,
    "mean_5": MetricRow.mean_5,
    "mean_20": MetricRow.mean_20,
    "mean_100": MetricRow.mean_100,
}
MEANS = {"mean_5": 5, "mean_20": 20, "mean_100": 100}
TAIL = max(MEANS.values())


def value_of(row: MetricRow, value: Value) -> float | None:
    """None where it is no finite number."""
    found: float | None = getattr(row, COLUMNS[value].key)
    return found


def widen(row: MetricRow, values: Floats) -> None:
    """Takes more points' extremes in; NaN has none."""
    finite = values[np.isfinite(values)]
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
        row.lowest = low if row.lowest is None else min(row.lowest, low)
        row.highest = high if row.highest is None else max(row.highest, high)


def take_tail(row: MetricRow, tail: Floats) -> None:
    """Takes the newest points, at least one and `TAIL` if there are as many, in order."""
    row.newest = _finite(float(tail[-1]))
    for name, n in MEANS.items():
        setattr(row, name, _finite(float(tail[-n:].mean())))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
