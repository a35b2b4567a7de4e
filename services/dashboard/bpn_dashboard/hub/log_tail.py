"""The end of a run's logs, followed while somebody reads them."""

import asyncio
import io
from collections.abc import Callable, Iterator
from pathlib import Path

import orjson

from bpn_shared import log_lines

PERIOD_S = 0.5
BACKLOG_BYTES = 64 * 1024
"""Of each file, how much from before is told first."""
_MAX_READ_BYTES = 256 * 1024
_MAX_LINE_CHARACTERS = 10_000


class _File:
    """What was read of one file so far."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = max(0, path.stat().st_size - BACKLOG_BYTES)
        self._skip_first = self._offset > 0  # it begins within a line
        self._level, self._service = "INFO", path.stem

    def new_lines(self) -> Iterator[tuple[float | None, bytes]]:
        """Time and JSON of every whole line that was added."""
        if self._path.stat().st_size < self._offset:
            self._offset = 0  # begun anew
        with self._path.open("rb") as file:
            file.seek(self._offset)
            data = file.read(_MAX_READ_BYTES)
        end = data.rfind(b"\n") + 1
        if end == 0 and len(data) == _MAX_READ_BYTES:
            end = len(data)  # no line is that long
        for raw in io.BytesIO(data[:end]):
            offset = self._offset
            self._offset += len(raw)
            if self._skip_first:
                self._skip_first = False
                continue
            yield self._entry(offset, raw.rstrip(b"\r\n").decode(errors="replace"))

    def _entry(self, offset: int, text: str) -> tuple[float | None, bytes]:
        line = log_lines.parse(text)
        if line.service is not None:
            self._service, self._level = line.service, line.level
        entry = {
            "id": f"{self._path.stem}:{offset}",
            "time_unix_s": line.time_unix_s,
            "level": self._level,  # a line without one belongs to the line before
            "service": self._service,
            "message": line.message[:_MAX_LINE_CHARACTERS],
        }
        return line.time_unix_s, orjson.dumps(entry)


class LogTail:
    """New lines of all `*.log` files in a folder, those of one look sorted by time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[Path, _File] = {}

    def new_lines(self) -> list[bytes]:
        """What was added since the last call, one JSON object per line; the first call tells the end."""
        lines: list[tuple[float, bytes]] = []
        for path in sorted(self._folder.glob("*.log")):
            try:
                file = self._files.setdefault(path, _File(path))
                time_unix_s = 0.0
                for own_unix_s, entry in file.new_lines():
                    time_unix_s = own_unix_s or time_unix_s
                    lines.append((time_unix_s, entry))
            except FileNotFoundError:  # removed in between
                self._files.pop(path, None)
        lines.sort(key=lambda line: line[0])
        return [entry for _, entry in lines]


def follow(folder: Path, put: Callable[[bytes], None]) -> Callable[[], None]:
    """Puts every new line until the returned function is called; reads on a thread of the loop's pool."""
    tail = LogTail(folder)

    async def read() -> None:
        while True:
            for line in await asyncio.to_thread(tail.new_lines):
                put(line)
            await asyncio.sleep(PERIOD_S)

    task = asyncio.create_task(read(), name=f"tail of {folder}")

    def stop() -> None:
        task.cancel()

    return stop
