"""Which runs, in which order, from where on: filters and keyset pages.

A page continues after the last row of the one before it, not at a count, so that runs which are made
meanwhile neither repeat nor hide others.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import BigInteger, ColumnElement, Select, and_, cast, func, or_, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.database.text_keys import folded
from bpn_dashboard.registry.errors import FilterError
from bpn_shared.spec.config import OPTIONS, RunConfig
from bpn_shared.spec.renamed import called_now

SORT_KEYS: dict[str, InstrumentedAttribute[Any]] = {
    column.key: column
    for column in (
        RunRow.created_at, RunRow.updated_at, RunRow.name, RunRow.state, RunRow.task,
        RunRow.algorithm, RunRow.seed, RunRow.iteration, RunRow.return_last,
        RunRow.return_best, RunRow.return_mean_last_5, RunRow.disk_bytes,
    )
} | {"name": RunRow.name_order}  # fmt: skip

Cursor = tuple[str | float | None, str]
"""Sort value and id of a page's last row. JSON can carry it."""


@dataclass(frozen=True)
class RunFilter:
    """Conditions that a run must all meet.

    Attributes:
        search: words that are each part of its name, notes, tags or id, in any case.
        states: one of these; empty: any.
        archived: whether it is archived; None: either.
        config: configuration keys with the value that they must have, as text.
        without: none of these, by id.
    """

    search: str = ""
    states: tuple[str, ...] = ()
    task: str | None = None
    algorithm: str | None = None
    sweep_id: str | None = None
    archived: bool | None = False
    config: Mapping[str, str] = field(default_factory=dict)
    without: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Page:
    """Some of the runs; `next_after` continues, `total` counts all that meet the filter."""

    rows: list[RunRow]
    next_after: Cursor | None
    total: int


def find_page(
    session: Session,
    runs: RunFilter,
    *,
    sort: str,
    descending: bool,
    after: Cursor | None,
    limit: int,
) -> Page:
    """A page of runs; those without a value of the sort key come last.

    Raises:
        FilterError: the sort key or a configuration key is unknown, or a value cannot be one.
    """
    if sort not in SORT_KEYS:
        raise FilterError(f"sort = {sort!r} is unknown; one of: {', '.join(SORT_KEYS)}")
    key = SORT_KEYS[sort]
    where = conditions(runs)
    total = session.scalar(select(func.count()).select_from(RunRow).where(*where)) or 0
    query: Select[RunRow] = select(RunRow).where(*where)
    if after is not None:
        query = query.where(_behind(key, descending, after))
    # Only where it changes something: with an expression in the order no index can give it.
    last = [key.is_(None)] if key.property.columns[0].nullable else []
    columns = (key, RunRow.id)
    query = query.order_by(*last, *(c.desc() if descending else c.asc() for c in columns))
    rows = list(session.scalars(query.limit(limit + 1)))
    more, rows = len(rows) > limit, rows[:limit]
    return Page(rows, (getattr(rows[-1], key.key), rows[-1].id) if more else None, total)


def states_of_sweeps(
    session: Session, sweep_ids: Sequence[str], *, without: Collection[str]
) -> dict[str, dict[str, int]]:
    """How many runs of each sweep are in each state, but for the runs `without`."""
    query = (
        select(RunRow.sweep_id, RunRow.state, func.count())
        .where(RunRow.sweep_id.in_(sweep_ids), RunRow.id.not_in(without))
        .group_by(RunRow.sweep_id, RunRow.state)
    )
    states: dict[str, dict[str, int]] = {sweep_id: {} for sweep_id in sweep_ids}
    for sweep_id, state, count in session.execute(query):
        states[str(sweep_id)][state] = count
    return states


def _behind(
    key: InstrumentedAttribute[Any], descending: bool, after: Cursor
) -> ColumnElement[bool]:
    value, run_id = after
    later_id = RunRow.id < run_id if descending else RunRow.id > run_id
    if value is None:
        return and_(key.is_(None), later_id)
    later = key < value if descending else key > value
    return or_(later, and_(key == value, later_id), key.is_(None))


def conditions(runs: RunFilter) -> list[ColumnElement[bool]]:
    """The filter as SQL conditions.

    Raises:
        FilterError: a configuration key is unknown, or a value cannot be one of that key.
    """
    words = folded(runs.search).split()
    found: list[ColumnElement[bool]] = [
        RunRow.search_text.contains(word, autoescape=True) for word in words
    ]
    if runs.states:
        found.append(RunRow.state.in_(runs.states))
    for column, value in (
        (RunRow.task, runs.task), (RunRow.algorithm, runs.algorithm), (RunRow.sweep_id, runs.sweep_id)
    ):  # fmt: skip
        if value is not None:
            found.append(column == value)
    if runs.archived is not None:
        given = RunRow.archived_at.is_not(None)
        found.append(given if runs.archived else RunRow.archived_at.is_(None))
    if runs.without:
        found.append(RunRow.id.not_in(runs.without))
    return found + [_config_is(key, text) for key, text in runs.config.items()]


def _config_is(key: str, text: str) -> ColumnElement[bool]:
    if key not in OPTIONS:
        why = called_now(key) or f"is unknown; one of: {', '.join(OPTIONS)}"
        raise FilterError(f"config.{key} {why}")
    known = RunConfig.model_fields[key]
    # Within its range: databases have one too.
    kind: Any = (
        Annotated[(known.annotation, *known.metadata)] if known.metadata else known.annotation
    )
    try:
        value = TypeAdapter(kind).validate_python(text)
    except ValidationError as error:
        raise FilterError(f"config.{key} = {text!r}: {error.errors()[0]['msg']}") from error
    found: ColumnElement[bool] = _AS_TYPE[type(value)](RunRow.config[key]) == value
    return found


_AS_TYPE: dict[type, Callable[[Any], Any]] = {
    bool: lambda stored: stored.as_boolean(),
    int: lambda stored: cast(stored.as_string(), BigInteger),  # seeds need more than 32 bits
    float: lambda stored: stored.as_float(),
    str: lambda stored: stored.as_string(),
}
