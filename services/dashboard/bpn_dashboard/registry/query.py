"""Which runs, in which order, from where on: filters and keyset pages.

A page continues after the last row of the one before it, not at a count, so that runs which are made
meanwhile neither repeat nor hide others.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import ColumnElement, and_, func, or_, select, true
from sqlalchemy.orm import Session

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.database.text_keys import folded
from bpn_dashboard.registry.columns import CONFIG, column_of, config_value
from bpn_dashboard.registry.errors import FilterError
from bpn_dashboard.registry.query_conditions import config_value_of, query_condition

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
        query: what they meet, in the language of `query_language`.
        without: none of these, by id.
    """

    search: str = ""
    states: tuple[str, ...] = ()
    task: str | None = None
    algorithm: str | None = None
    sweep_id: str | None = None
    archived: bool | None = False
    config: Mapping[str, str] = field(default_factory=dict)
    query: str = ""
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
    column = column_of(sort)
    key = column.expression
    where = conditions(runs)
    total = session.scalar(select(func.count()).select_from(RunRow).where(*where)) or 0
    query = select(RunRow, key).where(*where)
    if after is not None:
        query = query.where(_behind(key, descending, after))
    # Only where it changes something: with an expression in the order no index can give it.
    last = [key.is_(None)] if column.nullable else []
    columns = (key, RunRow.id)
    query = query.order_by(*last, *(c.desc() if descending else c.asc() for c in columns))
    found = session.execute(query.limit(limit + 1)).all()
    more, found = len(found) > limit, found[:limit]
    rows = [row for row, _ in found]
    return Page(rows, (found[-1][1], rows[-1].id) if more else None, total)


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


def _behind(key: ColumnElement[Any], descending: bool, after: Cursor) -> ColumnElement[bool]:
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
    found: list[ColumnElement[bool]] = []
    if runs.search.strip():
        found.append(_has_text(runs.search))
    if runs.query:
        found.append(query_condition(runs.query, _has_text))
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


def _has_text(text: str) -> ColumnElement[bool]:
    """Every word of a text is somewhere in it."""
    return and_(
        true(),
        *(RunRow.search_text.contains(word, autoescape=True) for word in folded(text).split()),
    )


def _config_is(key: str, text: str) -> ColumnElement[bool]:
    column = config_value(key)
    try:
        value = config_value_of(key, text)
    except ValueError as error:
        raise FilterError(f"{CONFIG}{error}") from error
    found: ColumnElement[bool] = column == value
    return found
