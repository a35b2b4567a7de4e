"""Values out of results: `FILE: PATH`, of a JSON document or of a table in a page that was made of one.

    docs/results/inference.json: result/candidates/golden/p50_us * 0.001
    docs/results/reaching.json: runs/algorithm=bpn/seconds/max()
    docs/results/reaching.md: BPN / return, last 10 (px)
    docs/results/heatmap.md: 16 + 0.5 / best iteration's return (px)

In JSON a segment is a key, an index, `key=value` (those elements of a list), or last a function over all that was
found; a key after a list is looked up in each element. In a table the first segment is the row's first cells,
joined by ` + `, the second the column's heading; all numbers of the cell are meant.
"""

import json
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from checks.text import numbers, tables

_FUNCTIONS: dict[str, Callable[[Sequence[float]], float]] = {
    "min()": min, "max()": max, "mean()": statistics.fmean, "len()": len, "sum()": sum,
}  # fmt: skip


class SourceError(ValueError):
    """The reference leads nowhere; the message says where it ends."""


def values(reference: str, root: Path) -> list[float]:
    """The numbers that a reference means, files relative to `root`.

    Raises:
        SourceError: it leads nowhere.
    """
    name, found, path = reference.partition(": ")
    file = root / name
    if not found or not file.is_file():
        raise SourceError(f"{reference!r} begins with no file that is there")
    path, _, factor = path.partition(" * ")
    if file.suffix == ".md":
        read = _cell(file.read_text(), path)
    else:
        read = _json_values(json.loads(file.read_bytes()), path)
    return [value * float(factor or 1) for value in read]


def _cell(page: str, path: str) -> list[float]:
    row_key, found, column = path.partition(" / ")
    key = row_key.split(" + ")
    for heading, *rows in tables(page):
        if found and column in heading:
            for row in rows:
                if row[: len(key)] == key:
                    return [float(number) for number in numbers(row[heading.index(column)])]
    raise SourceError(f"no table has a row {row_key!r} and a column {column!r}")


def _json_values(value: Any, path: str) -> list[float]:
    for segment in path.split("/"):
        try:
            value = _step(value, segment)
        except (KeyError, IndexError, TypeError, ValueError):
            raise SourceError(f"there is no {segment!r} on the way of {path!r}") from None
    found = value if isinstance(value, list) else [value]
    if not found or not all(isinstance(one, int | float) for one in found):
        raise SourceError(f"{path!r} leads to no numbers")
    return [float(one) for one in found]


def _step(value: Any, segment: str) -> Any:
    if segment in _FUNCTIONS:
        return _FUNCTIONS[segment](value)
    if not isinstance(value, list):
        return value[segment]
    key, found, wanted = segment.partition("=")
    if found:
        return [one for one in value if str(one[key]) == wanted]
    return value[int(segment)] if segment.isdigit() else [one[segment] for one in value]
