"""Series as files: one row for each run and iteration, one column for each metric."""

import csv
import io
import tempfile
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.errors import FilterError
from bpn_dashboard.series.query import SeriesQueries

Format = Literal["csv", "parquet"]
MEDIA_TYPES: dict[Format, str] = {
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
}
_ABOUT = ("run_id", "name", "task", "algorithm", "seed")
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_PIECE_BYTES = 64 * 1024


def tables(
    series: SeriesQueries, runs: Sequence[RunRow], metrics: Sequence[str]
) -> Iterator[pa.Table]:
    """One table for each run; NaN where a metric has no value at an iteration that another has."""
    for run in runs:
        found = series.points(run.id, metrics)
        steps = np.unique(
            np.concatenate([np.empty(0, np.int64), *(points.steps for points in found.values())])
        )
        columns: dict[str, Any] = {
            name: pa.array([value] * len(steps))
            for name, value in zip(
                _ABOUT, (run.id, run.name, run.task, run.algorithm, run.seed), strict=True
            )
        }
        columns["iteration"] = pa.array(steps)
        for metric in metrics:
            values = np.full(len(steps), np.nan)
            if metric in found:
                values[np.searchsorted(steps, found[metric].steps)] = found[metric].values
            columns[metric] = pa.array(values)
        yield pa.table(columns, schema=_schema(metrics))


def check(metrics: Sequence[str], known: Collection[str]) -> None:
    """Refuses what would be a column twice, or one without a value.

    Raises:
        FilterError: a metric stands twice, has a column's name, or is none of those known.
    """
    for index, metric in enumerate(metrics):
        if metric in metrics[:index]:
            raise FilterError(f"metrics: {metric} stands there twice")
        if metric in (*_ABOUT, "iteration"):
            raise FilterError(f"metrics: {metric} is the name of a column that is there already")
        if metric not in known:
            there = ", ".join(sorted(known)) or "none yet"
            raise FilterError(f"metrics: no run has {metric!r}; there are: {there[:1000]}")


def write(found: Iterable[pa.Table], metrics: Sequence[str], form: Format) -> Iterator[bytes]:
    """The tables as pieces of one file."""
    return _csv(found, metrics) if form == "csv" else _parquet(found, metrics)


def _schema(metrics: Sequence[str]) -> pa.Schema:
    about = [(name, pa.int64() if name == "seed" else pa.string()) for name in _ABOUT]
    return pa.schema([*about, ("iteration", pa.int64()), *((m, pa.float64()) for m in metrics)])


def _csv(found: Iterable[pa.Table], metrics: Sequence[str]) -> Iterator[bytes]:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_ABOUT, "iteration", *metrics])
    for table in found:
        for row in zip(*(column.to_pylist() for column in table.columns), strict=True):
            writer.writerow([_cell(value) for value in row])
            if text.tell() > _PIECE_BYTES:
                yield text.getvalue().encode()
                text.seek(0)
                text.truncate()
    yield text.getvalue().encode()


def _cell(value: Any) -> Any:
    """Nothing for NaN; and no text that a spreadsheet takes for a formula."""
    if isinstance(value, str):
        return f"'{value}" if value.startswith(_FORMULA) else value
    return "" if value != value else value  # noqa: PLR0124 - NaN


def _parquet(found: Iterable[pa.Table], metrics: Sequence[str]) -> Iterator[bytes]:
    with tempfile.TemporaryFile() as file:
        with pq.ParquetWriter(file, _schema(metrics), compression="zstd") as writer:
            for table in found:
                writer.write_table(table)
        file.seek(0)
        while piece := file.read(_PIECE_BYTES):
            yield piece
