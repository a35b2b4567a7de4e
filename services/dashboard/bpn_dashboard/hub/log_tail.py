"""The end of a run's logs, followed while somebody reads them."""

import asyncio
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import orjson

from bpn_shared.messages import log_lines
from bpn_shared.runs.opening import file_names
from bpn_shared.runs.tail import Tail, near_end

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

    def __init__(self, path: Path, root: Path) -> None:
        self._tail = Tail(path, near_end(path, BACKLOG_BYTES, root=root), root=root)
        self._level, self._service = "INFO", path.stem

    def new_entries(self) -> list[_Entry]:
        """What the whole lines say that were added."""
        growth = self._tail.read(_MAX_READ_BYTES)
        entries: list[_Entry] = []
        offset = growth.offset
        for raw in io.BytesIO(growth.data):
            self._add(entries, offset, raw.rstrip(b"\r\n").decode(errors="replace"))
            offset += len(raw)
        return entries

    def _add(self, entries: list[_Entry], offset: int, text: str) -> None:
        line = log_lines.parse(text)
        if line.service is not None:
            self._service, self._level = line.service, line.level
        elif entries:
            entries[-1].lines.append(text)
            return
        name = f"{self._tail.path.stem}:{offset}"
        entries.append(_Entry(name, line.time_unix_s, self._level, self._service, [line.message]))


class LogTail:
    """What is added to all `*.log` files in a folder; what one look finds is sorted by time.

    Args:
        root: a directory above it, between which and the files no link is followed.
    """

    def __init__(self, folder: Path, root: Path | None = None) -> None:
        self._folder, self._root = folder, root or folder
        self._files: dict[Path, _File] = {}

    def new_entries(self) -> list[bytes]:
        """What was added since the last call, a JSON object for each entry; at first, the files' ends."""
        entries: list[tuple[float, _Entry]] = []
        inside = self._folder.relative_to(self._root)
        for path in map(self._folder.joinpath, file_names(self._root, inside, suffix=".log")):
            try:
                if path not in self._files:
                    self._files[path] = _File(path, self._root)
                file = self._files[path]
                time_unix_s = 0.0
                for entry in file.new_entries():
                    time_unix_s = entry.time_unix_s or time_unix_s
                    entries.append((time_unix_s, entry))
            except OSError:  # removed in between, or no file of the run's own
                self._files.pop(path, None)
        entries.sort(key=lambda timed: timed[0])
        return [entry.encode() for _, entry in entries]


def follow(folder: Path, put: Callable[[bytes], None], root: Path) -> Callable[[], None]:
    """Puts every new line until the returned function is called; reads on a thread of the loop's pool."""
    tail = LogTail(folder, root)

    async def read() -> None:
        while True:
            for line in await asyncio.to_thread(tail.new_entries):
                put(line)
            await asyncio.sleep(PERIOD_S)

    task = asyncio.create_task(read(), name=f"tail of {folder}")

    def stop() -> None:
        task.cancel()

    return stop
