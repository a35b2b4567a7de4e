"""The end of a run's logs, followed while somebody reads them."""

import asyncio
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import orjson

from bpn_shared import log_lines

PERIOD_S = 0.5
BACKLOG_BYTES = 64 * 1024
"""Of each file, how much from before is told first."""
_MAX_READ_BYTES = 256 * 1024
_MAX_CHARACTERS = 10_000


@dataclass
class _Entry:
    """What a service said once, with the lines of a traceback that came with it."""

    id: str
    time_unix_s: float | None
    level: str
    service: str
    lines: list[str]

    def encode(self) -> bytes:
        """The entry as JSON."""
        entry = {
            "id": self.id,
            "time_unix_s": self.time_unix_s,
            "level": self.level,
            "service": self.service,
            "message": "\n".join(self.lines)[:_MAX_CHARACTERS],
        }
        return orjson.dumps(entry)


class _File:
    """What was read of one file so far."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = max(0, path.stat().st_size - BACKLOG_BYTES)
        self._skip_first = self._offset > 0  # it begins within a line
        self._level, self._service = "INFO", path.stem

    def new_entries(self) -> list[_Entry]:
        """What the whole lines say that were added."""
        if self._path.stat().st_size < self._offset:
            self._offset = 0  # begun anew
        with self._path.open("rb") as file:
            file.seek(self._offset)
            data = file.read(_MAX_READ_BYTES)
        end = data.rfind(b"\n") + 1
        if end == 0 and len(data) == _MAX_READ_BYTES:
            end = len(data)  # no line is that long
        entries: list[_Entry] = []
        for raw in io.BytesIO(data[:end]):
            offset = self._offset
            self._offset += len(raw)
            if self._skip_first:
                self._skip_first = False
                continue
            self._add(entries, offset, raw.rstrip(b"\r\n").decode(errors="replace"))
        return entries

    def _add(self, entries: list[_Entry], offset: int, text: str) -> None:
        line = log_lines.parse(text)
        if line.service is not None:
            self._service, self._level = line.service, line.level
        elif entries:
            entries[-1].lines.append(text)
            return
        name = f"{self._path.stem}:{offset}"
        entries.append(_Entry(name, line.time_unix_s, self._level, self._service, [line.message]))


class LogTail:
    """What is added to all `*.log` files in a folder; what one look finds is sorted by time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[Path, _File] = {}

    def new_entries(self) -> list[bytes]:
        """What was added since the last call, a JSON object for each entry; at first, the files' ends."""
        entries: list[tuple[float, _Entry]] = []
        for path in sorted(self._folder.glob("*.log")):
            try:
                file = self._files.setdefault(path, _File(path))
                time_unix_s = 0.0
                for entry in file.new_entries():
                    time_unix_s = entry.time_unix_s or time_unix_s
                    entries.append((time_unix_s, entry))
            except FileNotFoundError:  # removed in between
                self._files.pop(path, None)
        entries.sort(key=lambda timed: timed[0])
        return [entry.encode() for _, entry in entries]


def follow(folder: Path, put: Callable[[bytes], None]) -> Callable[[], None]:
    """Puts every new line until the returned function is called; reads on a thread of the loop's pool."""
    tail = LogTail(folder)

    async def read() -> None:
        while True:
            for line in await asyncio.to_thread(tail.new_entries):
                put(line)
            await asyncio.sleep(PERIOD_S)

    task = asyncio.create_task(read(), name=f"tail of {folder}")

    def stop() -> None:
        task.cancel()

    return stop
