"""What the services of a run said, newest first."""

import heapq
import math
import os
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Annotated, BinaryIO, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from bpn_dashboard.api.context import Parts, Viewer
from bpn_dashboard.api.problems import responses
from bpn_shared.messages import log_lines
from bpn_shared.runs.folder import RunFolder

router = APIRouter(tags=["logs"])

Level = Literal["DEBUG", "INFO", "WARNING", "ERROR", "CRITICAL"]

_BLOCK_BYTES = 256 * 1024
_MAX_LINE_BYTES = 64 * 1024
_MAX_FOLLOWING = 200
_SUFFIX = ".log"
_MAX_FILES = 200
"""Of one run; more than services have, and fewer than a process may open."""
_MAX_NAME = 64
_MAX_SCANNED = 200_000
"""Lines that one request reads; whoever wants more goes on from the cursor."""


class LogQuery(BaseModel):
    """Which lines."""

    model_config = {"extra": "forbid"}

    service: Annotated[str | None, Field(max_length=100)] = None
    level: Annotated[Level | None, Field(description="this level or a higher one")] = None
    search: Annotated[str, Field(max_length=200, description="part of it, in any case")] = ""
    cursor: Annotated[str | None, Field(max_length=24_000)] = None
    limit: Annotated[int, Field(ge=1, le=1000)] = 200


class LogItem(BaseModel):
    """What a service said once, with the traceback that belongs to it."""

    id: str
    time_unix_s: float | None
    level: str
    service: str
    message: str


class LogPage(BaseModel):
    """Newest first. `next_cursor` leads to older ones; a page may have fewer than asked for before the end."""

    items: list[LogItem]
    next_cursor: str | None
    services: Annotated[list[str], Field(description="that have a log, whatever the filter")]


@router.get("/runs/{run_id}/logs", operation_id="getLogs", responses=responses(404, 422))
def get_logs(
    _who: Viewer, parts: Parts, run_id: str, query: Annotated[LogQuery, Query()]
) -> LogPage:
    """Lines of the run's services, newest first."""
    parts.runs.get(run_id)
    scope = ["logs", run_id, query.model_dump(exclude={"cursor", "limit"})]
    with ExitStack() as stack:
        folder = parts.runs.folder(run_id)
        services = _services(folder)
        files = _open_logs(folder, services, query.service, stack)
        ends = {name: os.fstat(file.fileno()).st_size for name, file in files.items()}
        if query.cursor is not None:
            ends |= parts.cursors.decode(query.cursor, scope)
        items: list[LogItem] = []
        entries = heapq.merge(
            *(_entries(name, file, ends[name]) for name, file in files.items()),
            key=lambda entry: -entry.time_unix_s,
        )
        for scanned, entry in enumerate(entries):
            if len(items) == query.limit or scanned == _MAX_SCANNED:
                cursor = parts.cursors.encode(ends, scope)
                return LogPage(items=items, next_cursor=cursor, services=services)
            ends[entry.service] = entry.begin
            if _wanted(entry.line, query):
                items.append(_shown(entry))
    return LogPage(items=items, next_cursor=None, services=services)


def _services(folder: RunFolder) -> list[str]:
    """Whose logs the run has."""
    names = folder.file_names("logs", suffix=_SUFFIX)
    return [stem for name in names if _is_ours(stem := name.removesuffix(_SUFFIX))][:_MAX_FILES]


def _open_logs(
    folder: RunFolder, services: list[str], service: str | None, stack: ExitStack
) -> dict[str, BinaryIO]:
    """The run's log files by service, or that of one; the stack closes them."""
    files: dict[str, BinaryIO] = {}
    for name in services if service is None else {service} & set(services):
        with suppress(OSError):  # it went away in between
            files[name] = stack.enter_context(folder.open_file(f"logs/{name}{_SUFFIX}"))
    return files


def _is_ours(service: str) -> bool:
    return service.isprintable() and len(service) <= _MAX_NAME


@dataclass(frozen=True)
class _Entry:
    """A line with those that belong to it.

    Attributes:
        begin: where it stands in its file; what is older stands before.
        time_unix_s: its time, or that of the next line that has one.
    """

    service: str
    begin: int
    time_unix_s: float
    line: log_lines.LogLine


def _entries(service: str, file: BinaryIO, end: int) -> Iterator[_Entry]:
    """The entries that begin before `end`, from the last to the first."""
    following: list[str] = []
    time_unix_s = math.inf
    for begin, data in _lines_backwards(file, end):
        text = data.decode("utf-8", "replace")
        line = log_lines.parse(text)
        if line.time_unix_s is None and begin > 0 and len(following) < _MAX_FOLLOWING:
            following.append(text)
            continue
        time_unix_s = time_unix_s if line.time_unix_s is None else line.time_unix_s
        message = "\n".join([line.message, *reversed(following)])[:_MAX_LINE_BYTES]
        following.clear()
        yield _Entry(service, begin, time_unix_s, line._replace(message=message))


def _lines_backwards(file: BinaryIO, end: int) -> Iterator[tuple[int, bytes]]:
    """Where each line before `end` begins, and the line, of a very long one its beginning; whole lines only."""
    rest, left_out = b"", 0
    while end > 0:
        begin = max(0, end - _BLOCK_BYTES)
        file.seek(begin)
        data = file.read(end - begin) + rest
        cut = (data.find(b"\n") + 1 or len(data)) if begin > 0 else 0
        position = begin + len(data) + left_out
        for line in reversed(data[cut:].split(b"\n")):
            position -= len(line) + left_out
            left_out = 0
            if line:
                yield position, line[:_MAX_LINE_BYTES]
            position -= 1
        rest, end = data[:cut], begin
        left_out += max(0, len(rest) - _MAX_LINE_BYTES)
        rest = rest[:_MAX_LINE_BYTES]


def _wanted(line: log_lines.LogLine, query: LogQuery) -> bool:
    levels = log_lines.LEVELS
    if query.level is not None and levels.index(line.level) < levels.index(query.level):
        return False
    return query.search.casefold() in line.message.casefold()


def _shown(entry: _Entry) -> LogItem:
    return LogItem(
        id=f"{entry.service}:{entry.begin}",
        time_unix_s=entry.line.time_unix_s,
        level=entry.line.level,
        service=entry.line.service or entry.service,
        message=entry.line.message,
    )
