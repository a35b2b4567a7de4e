"""Values out of results: `FILE: PATH`, of a JSON document or of a table in a page that was made of one.

    docs/results/inference.json: result/candidates/golden/p50_us * 0.001
    docs/results/reaching.json: runs/algorithm=bpn/seconds/max()
    docs/results/reaching.md: BPN / return, last 10 (px)
    docs/results/heatmap.md: 16 + 0.5 / best iteration's return (px)

In JSON a segment is a key, an index, `key=value` (those elements of a list), or last a function over all that was
found; a key after a list is looked up in each element. In a table the first segment is the row's first cells,
joined by ` + `, the second the column's heading, the third the number's place in the cell (without it: all of
them). `network: C/N/A/weights` or `.../bytes` is the size of a binarized network, and `A minus B` a difference.
"""

import json
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bpn_shared.bnn import blob
from bpn_shared.spec.network import NetworkSpec
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
    first, found, second = reference.partition(" minus ")
    if found:
        return [a - b for a, b in zip(values(first, root), values(second, root), strict=True)]
    name, found, rest = reference.partition(": ")
    path, _, factor = rest.partition(" * ")
    return [value * float(factor or 1) for value in _read(name, path, root)]


def _read(name: str, path: str, root: Path) -> list[float]:
    if name == "network":
        return [_network(path)]
    file = root / name
    if not path or not file.is_file():
        raise SourceError(f"{name!r} is no file that is there")
    if file.suffix == ".md":
        return _cell(file.read_text(), path)
    return _json_values(json.loads(file.read_bytes()), path)


def _cell(page: str, path: str) -> list[float]:
    row_key, column, *place = [*path.split(" / "), ""][:3]
    key = row_key.split(" + ")
    for heading, *rows in tables(page):
        for row in rows:
            if column in heading and row[: len(key)] == key:
                found = [float(number) for number in numbers(row[heading.index(column)])]
                return found if place == [""] else [found[int(place[0])]]
    raise SourceError(f"no table has a row {row_key!r} and a column {column!r}")


def _network(path: str) -> float:
    channels, hidden_units, actions, what = path.split("/")
    spec = NetworkSpec(channels=int(channels), hidden_units=int(hidden_units), actions=int(actions))
    if what == "bytes":
        return blob.encoded_size(spec)
    return sum(layer.out_channels * layer.fan_in for layer in spec.layers)


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
