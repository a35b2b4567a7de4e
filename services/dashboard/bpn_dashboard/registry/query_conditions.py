"""What a query of `query_language` means: its fields, and the query as SQL.

A run that has no value of a field meets no comparison with it, and every `not` of one.
"""

import difflib
import json
import math
import re
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Annotated, Any, cast, get_args

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import ColumnElement, String, and_, func, not_, or_, select, true
from sqlalchemy import cast as sql_cast

from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.columns import CONFIG, METRIC, config_type, config_value, metric_value
from bpn_dashboard.registry.query_language import (
    Both,
    Comparison,
    Either,
    Node,
    Not,
    Operator,
    QueryError,
    Text,
    parse,
)
from bpn_dashboard.series.summary import VALUES
from bpn_shared.runs.folder import State
from bpn_shared.spec.config import OPTIONS, RunConfig
from bpn_shared.spec.renamed import called_now

Condition = ColumnElement[bool]

_STATES: tuple[str, ...] = get_args(State.__value__ if hasattr(State, "__value__") else State)
_UNITS_S = {"s": 1, "min": 60, "h": 3600, "d": 86400, "w": 604800}
_AGE = re.compile(r"(\d+(?:\.\d+)?)(s|min|h|d|w)")
_ORDERS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": lambda one, other: one < other,
    "<=": lambda one, other: one <= other,
    ">": lambda one, other: one > other,
    ">=": lambda one, other: one >= other,
}


def query_condition(text: str, search: Callable[[str], Condition]) -> Condition:
    """The query as a condition on `RunRow`.

    Args:
        search: runs in which a text stands somewhere.

    Raises:
        QueryError: the query is none, has an unknown field or an impossible value.
    """
    found = parse(text)
    return true() if found is None else _condition(found, search)


def _condition(node: Node, search: Callable[[str], Condition]) -> Condition:
    match node:
        case Text(text):
            return search(text)
        case Not(inside):
            return not_(_condition(inside, search))
        case Both(parts):
            return and_(*(_condition(part, search) for part in parts))
        case Either(parts):
            return or_(*(_condition(part, search) for part in parts))
        case Comparison():
            return _comparison(node)


def _comparison(asked: Comparison) -> Condition:
    if asked.operator == "!=":
        equal = Comparison(asked.field, "=", asked.values, asked.position, asked.at)
        return not_(_comparison(equal))
    meets = _field(asked)
    try:
        conditions = [meets(asked.operator, value) for value in asked.values]
    except ValueError as error:
        raise QueryError(str(error), asked.at) from error
    return func.coalesce(or_(*conditions), False)


_Meets = Callable[[Operator, str], Condition]


def _field(asked: Comparison) -> _Meets:
    name = asked.field
    config = name.removeprefix(CONFIG)
    metric, _, value = name.removeprefix(METRIC).rpartition(".")
    if name in _OWN:
        return _OWN[name]
    if config in OPTIONS:
        return _config(config)
    if metric and value in VALUES:
        return _number(metric_value(metric, value))
    raise QueryError(_unknown(name), asked.position)


def _unknown(name: str) -> str:
    if (today := called_now(name.removeprefix(CONFIG))) is not None:
        return f"{name} {today}"
    near = difflib.get_close_matches(name, (*FIELDS, *OPTIONS), n=1)
    if near:
        return f"there is no field {name}; did you mean {near[0]}?"
    return (
        f"there is no field {name}; there are {', '.join(FIELDS)}, the keys of the configuration, and of each "
        f"metric NAME.VALUE, such as loss.last ({', '.join(VALUES)}). To search for that text, put it in quotes"
    )


def _number(column: Any) -> _Meets:
    def meets(operator: Operator, text: str) -> Condition:
        value = _float(text)
        return _compared(column, operator, value)

    return meets


def _float(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is no finite number")
    return value


def _compared(column: Any, operator: Operator, value: Any) -> Condition:
    order = _ORDERS.get(operator)
    found: Condition = column == value if order is None else order(column, value)
    return found


def _text(column: Any) -> _Meets:
    def meets(operator: Operator, text: str) -> Condition:
        if operator == ":":
            return cast(Condition, column.icontains(text, autoescape=True))
        _only_equal(operator)
        return cast(Condition, column == text)

    return meets


def _name(column: Any) -> _Meets:
    def meets(operator: Operator, text: str) -> Condition:
        _only_equal(operator)
        return cast(Condition, column == text)

    return meets


def _only_equal(operator: Operator) -> None:
    if operator not in (":", "="):
        raise ValueError(f"{operator} compares numbers and times; this takes : and =")


def _state(operator: Operator, text: str) -> Condition:
    _only_equal(operator)
    if text not in _STATES:
        raise ValueError(f"{text!r} is no state; there are {', '.join(_STATES)}")
    return RunRow.state == text


def _tag(operator: Operator, text: str) -> Condition:
    """The very tag: JSON escapes the quotation marks inside a text, so those around it are its ends."""
    _only_equal(operator)
    return sql_cast(RunRow.tags, String).contains(json.dumps(text), autoescape=True)


def _sweep(operator: Operator, text: str) -> Condition:
    _only_equal(operator)
    named = select(SweepRow.id).where(or_(SweepRow.name == text, SweepRow.id == text))
    return RunRow.sweep_id.in_(named)


def _time(column: Any) -> _Meets:
    def meets(operator: Operator, text: str) -> Condition:
        try:
            at = datetime.fromisoformat(text)
        except ValueError:
            raise ValueError(
                f"{text!r} is no day or time such as 2026-11-28 or 2026-11-28T09:30 (UTC); how long ago "
                "something was made is age<7d"
            ) from None
        begin_s = (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
        whole_s = 86400 if "T" not in text and " " not in text else 60
        if operator in (":", "="):
            return and_(column >= begin_s, column < begin_s + whole_s)
        if operator in (">", "<="):  # a day is over at its end, and begins at its beginning
            turned: Operator = ">=" if operator == ">" else "<"
            return _compared(column, turned, begin_s + whole_s)
        return _compared(column, operator, begin_s)

    return meets


def _age(operator: Operator, text: str) -> Condition:
    found = _AGE.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is no length of time such as 30min, 12h, 7d or 2w")
    since_s = time.time() - float(found[1]) * _UNITS_S[found[2]]
    if operator in (":", "="):
        raise ValueError("an age is compared: age<7d, age>12h")
    turned: dict[str, Operator] = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
    return _compared(RunRow.created_at, turned[operator], since_s)


def _config(key: str) -> _Meets:
    kind = config_type(key)
    column = config_value(key)

    def meets(operator: Operator, text: str) -> Condition:
        if operator in _ORDERS:
            if kind in (bool, str):
                raise ValueError(f"{key} is no number: it takes : and =")
            return _compared(column, operator, _float(text))
        return cast(Condition, column == config_value_of(key, text))

    return meets


def config_value_of(key: str, text: str) -> Any:
    """A configuration value from a text, within its range: databases have one too.

    Raises:
        ValueError: it can be none of that key.
    """
    known = RunConfig.model_fields[key]
    kind: Any = (
        Annotated[(known.annotation, *known.metadata)] if known.metadata else known.annotation
    )
    try:
        return TypeAdapter(kind).validate_python(text)
    except ValidationError as error:
        raise ValueError(f"{key} = {text!r}: {error.errors()[0]['msg']}") from error


_OWN: Mapping[str, _Meets] = {
    "name": _text(RunRow.name),
    "notes": _text(RunRow.notes),
    "id": _text(RunRow.id),
    "error": _text(RunRow.error),
    "waiting": _text(RunRow.waiting_reason),
    "state": _state,
    "tag": _tag,
    "sweep": _sweep,
    "task": _name(RunRow.task),
    "algorithm": _name(RunRow.algorithm),
    "iteration": _number(RunRow.iteration),
    "progress": _number(RunRow.iteration * 1.0 / func.nullif(RunRow.iterations, 0)),
    "attempt": _number(RunRow.attempt),
    "weights": _number(RunRow.weights_version),
    "priority": _number(RunRow.priority),
    "length": _number(RunRow.length_last),
    "return": _number(RunRow.return_last),
    "return.last": _number(RunRow.return_last),
    "return.best": _number(RunRow.return_best),
    "return.mean_5": _number(RunRow.return_mean_last_5),
    "created": _time(RunRow.created_at),
    "changed": _time(RunRow.updated_at),
    "age": _age,
}
FIELDS = tuple(_OWN)
"""Beside the keys of the configuration and METRIC.VALUE. Of texts `:` finds a part, in any case."""
