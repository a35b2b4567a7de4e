"""Single lines of a run folder's JSON-lines files, found without reading the others."""

import mmap
from pathlib import Path
from typing import Any

import orjson


def record_of(path: Path, iteration: int) -> dict[str, Any] | None:
    """The last record of an iteration, or None if there is none yet.

    Every line begins with its iteration, so the file is searched for that beginning, from its end.
    """
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return _search(data, b'{"iteration": %d,' % iteration)
    except (FileNotFoundError, ValueError):  # ValueError: the file is empty
        return None


def _search(data: mmap.mmap, beginning: bytes) -> dict[str, Any] | None:
    end = len(data)
    while (at := data.rfind(beginning, 0, end)) >= 0:
        line_end = data.find(b"\n", at)
        if line_end >= 0 and (at == 0 or data[at - 1] == ord("\n")):
            try:
                return dict(orjson.loads(data[at:line_end]))
            except orjson.JSONDecodeError:
                pass  # a crash cut this line; an earlier one may be whole
        end = at
    return None
