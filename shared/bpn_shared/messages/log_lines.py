"""The form of a log line: written by every service, read by whoever shows logs.

`2026-11-22T08:22:35.123Z edge-0 WARNING text`: time in UTC, so that lines of several hosts sort together.
A traceback follows its line without a prefix; such lines belong to the one before.
"""

import logging
import re
import time
from datetime import UTC, datetime
from typing import NamedTuple

LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR", "CRITICAL")

_LINE = re.compile(
    r"(?P<time>\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3})Z (?P<service>\S+) "
    rf"(?P<level>{'|'.join(LEVELS)}) (?P<message>.*)",
    re.DOTALL,
)


class LogLine(NamedTuple):
    """One line. `time_unix_s` and `service` are None where a line has no prefix of ours."""

    time_unix_s: float | None
    service: str | None
    level: str
    message: str


def formatter(service: str) -> logging.Formatter:
    """Writes lines of that service."""
    form = logging.Formatter(
        f"%(asctime)s.%(msecs)03dZ {service} %(levelname)s %(message)s", "%Y-%m-%dT%H:%M:%S"
    )
    form.converter = time.gmtime
    return form


def parse(line: str) -> LogLine:
    """Reads a line; one without a prefix of ours (a traceback, another program) is all message."""
    match = _LINE.fullmatch(line)
    if match is None:
        return LogLine(None, None, "INFO", line)
    try:
        moment = datetime.fromisoformat(match["time"]).replace(tzinfo=UTC)
    except ValueError:  # the form of a time, but none: month 13
        return LogLine(None, None, "INFO", line)
    return LogLine(moment.timestamp(), match["service"], match["level"], match["message"])
