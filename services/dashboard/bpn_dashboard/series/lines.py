"""Lines of metrics.jsonl as series: every number of a record, nested ones under names joined by dots."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import orjson

from bpn_dashboard.series.points import Points
from bpn_shared.runs.digests import DamagedError, check_line

MAX_ITERATION = 2**53
"""Up to here float64 has every integer."""
MAX_NAME = 200
_MAX_DEPTH = 8
_NO_SERIES = ("iteration",)


class LineError(ValueError):
    """A line is no record of metrics; the message says in what way."""


def parse_lines(data: bytes) -> tuple[dict[str, Points], list[LineError]]:
    """The series in some whole lines, and what is wrong with those that are no records.

    Numbers and truth values are points, null is a point that is NaN; texts and lists are none.
    """
    steps: dict[str, list[int]] = defaultdict(list)
    values: dict[str, list[float]] = defaultdict(list)
    errors = []
    for line in data.split(b"\n"):
        if not line or line.isspace():
            continue
        try:
            record = _record(line)
        except LineError as error:
            errors.append(error)
            continue
        iteration = record["iteration"]
        for name, value in _numbers(record):
            steps[name].append(iteration)
            values[name].append(value)
    return {name: Points.written(steps[name], values[name]) for name in steps}, errors


def _record(line: bytes) -> dict[str, Any]:
    try:
        check_line(line)
        record = orjson.loads(line)
    except DamagedError as error:
        raise LineError(f"{line[:60]!r} is damaged: {error}") from error
    except orjson.JSONDecodeError as error:
        raise LineError(f"{line[:60]!r} is no JSON: {error}") from error
    iteration = record.get("iteration") if isinstance(record, dict) else None
    if type(iteration) is not int or not 0 <= iteration < MAX_ITERATION:
        raise LineError(f"{line[:60]!r} has no iteration from 0 on")
    return dict(record)


def _numbers(
    record: Mapping[str, Any], prefix: str = "", depth: int = 0
) -> Iterator[tuple[str, float]]:
    for key, value in record.items():
        name = prefix + key
        if isinstance(value, (float, int)):
            if len(name) <= MAX_NAME and name not in _NO_SERIES:
                yield name, value
        elif value is None:
            yield name[:MAX_NAME], float("nan")
        elif isinstance(value, dict) and depth < _MAX_DEPTH:
            yield from _numbers(value, name + ".", depth + 1)
