"""Single lines of a run folder's JSON-lines files, found without reading the others.

Read piece by piece, not mapped into memory: a mapped file that another program cuts short ends the reader.
"""

from typing import Any, BinaryIO

import orjson

from bpn_shared.runs.digests import DamagedError, check_line
from bpn_shared.runs.folder import RunFolder

_PIECE_BYTES = 1024 * 1024
_MAX_LINE_BYTES = 64 * 1024 * 1024


def record_of(folder: RunFolder, name: str, iteration: int) -> dict[str, Any] | None:
    """The last record of an iteration in a file of a run, or None if there is none yet.

    Every line begins with its iteration, so the file is searched for that beginning, from its end.
    """
    try:
        with folder.open_file(name) as file:
            return _search(file, b'\n{"iteration": %d,' % iteration)
    except OSError:
        return None


def _search(file: BinaryIO, beginning: bytes) -> dict[str, Any] | None:
    end, overlap = file.seek(0, 2), b""
    while end > 0:
        begin = max(0, end - _PIECE_BYTES)
        file.seek(begin)
        # A newline before the first line too, so that all begin alike.
        data = (b"" if begin else b"\n") + file.read(end - begin) + overlap
        at = len(data)
        while (at := data.rfind(beginning, 0, at)) >= 0:
            file.seek(begin + at + (1 if begin else 0))
            line = file.readline(_MAX_LINE_BYTES)
            if line.endswith(b"\n"):
                try:
                    check_line(line[:-1])
                    return dict(orjson.loads(line))
                except (DamagedError, orjson.JSONDecodeError):
                    pass  # a crash cut this line, or it was changed; an earlier one may be whole
        end, overlap = begin, data[: len(beginning) - 1]
    return None


def number_at(record: dict[str, Any] | None, key: str, *indices: int) -> float | None:
    """A number in nested lists of a record; None where there is none, whatever else stands there."""
    value: Any = (record or {}).get(key)
    for index in indices:
        if not isinstance(value, list) or index >= len(value):
            return None
        value = value[index]
    return value if isinstance(value, (int, float)) and not isinstance(value, bool) else None
