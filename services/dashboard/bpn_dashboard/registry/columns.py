"""Everything that a table of runs can show, order by and be filtered by, as SQL.

That is a run's own columns, the keys of its configuration, and what its metrics came to.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import BigInteger, ColumnElement, select
from sqlalchemy import cast as sql_cast

from bpn_dashboard.database.series_tables import MetricRow
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.errors import FilterError
from bpn_dashboard.series.summary import COLUMNS, VALUES, Value
from bpn_shared.spec.config import OPTIONS, RunConfig
from bpn_shared.spec.renamed import called_now

CONFIG = "config."
METRIC = "metric."
OWN: dict[str, Any] = {
    column.key: column
    for column in (
        RunRow.created_at, RunRow.updated_at, RunRow.state, RunRow.task,
        RunRow.algorithm, RunRow.seed, RunRow.iteration, RunRow.return_last, RunRow.return_best,
        RunRow.return_mean_last_5, RunRow.length_last, RunRow.error, RunRow.attempt,
        RunRow.weights_version, RunRow.disk_bytes, RunRow.priority,
    )
} | {"name": RunRow.name_order}  # fmt: skip
_NULLABLE = {
    RunRow.return_last.key, RunRow.return_best.key, RunRow.return_mean_last_5.key,
    RunRow.length_last.key, RunRow.weights_version.key, RunRow.disk_bytes.key,
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """What to order by.

    Attributes:
        nullable: some runs have no value of it.
    """

    expression: ColumnElement[Any]
    nullable: bool


def column_of(name: str) -> Column:
    """A column by its name: one of a run's own, `config.KEY`, or `metric.NAME.VALUE`.

    Raises:
        FilterError: there is none of that name; the message says which there are.
    """
    if name.startswith(CONFIG):
        return Column(config_value(name.removeprefix(CONFIG)), nullable=True)
    if name.startswith(METRIC):
        return Column(metric_value(*metric_of(name)), nullable=True)
    if name not in OWN:
        raise FilterError(
            f"{name!r} is no column; there are {', '.join(OWN)}, {CONFIG}KEY and {METRIC}NAME.VALUE"
        )
    return Column(OWN[name], nullable=name in _NULLABLE)


def metric_of(name: str) -> tuple[str, Value]:
    """Metric and value of `metric.NAME.VALUE`.

    Raises:
        FilterError: it is none.
    """
    metric, _, value = name.removeprefix(METRIC).rpartition(".")
    if not metric or value not in VALUES:
        raise FilterError(
            f"{name!r}: a metric's column is NAME.VALUE, VALUE one of {', '.join(VALUES)}"
        )
    return metric, value


def metric_value(metric: str, value: Value) -> ColumnElement[Any]:
    """What a metric came to."""
    found = select(COLUMNS[value]).where(MetricRow.run_id == RunRow.id, MetricRow.name == metric)
    return found.scalar_subquery()


def config_value(key: str) -> ColumnElement[Any]:
    """A configuration value, with the type that the key has.

    Raises:
        FilterError: there is no such key.
    """
    found: ColumnElement[Any] = _AS_TYPE[config_type(key)](RunRow.config[key])
    return found


def config_type(key: str) -> type:
    """Of a configuration key's values: bool, int, float or str.

    Raises:
        FilterError: there is no such key.
    """
    if key not in OPTIONS:
        why = called_now(key) or f"is unknown; one of: {', '.join(OPTIONS)}"
        raise FilterError(f"{CONFIG}{key} {why}")
    kind = RunConfig.model_fields[key].annotation
    return kind if isinstance(kind, type) else str  # a choice among texts


_AS_TYPE: dict[type, Callable[[Any], Any]] = {
    bool: lambda stored: stored.as_boolean(),
    int: lambda stored: sql_cast(stored.as_string(), BigInteger),  # seeds need more than 32 bits
    float: lambda stored: stored.as_float(),
    str: lambda stored: stored.as_string(),
}
