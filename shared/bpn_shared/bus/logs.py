"""Log lines of workers that do not share the run folder, on their way there."""

import contextlib
import logging
import os
import re
import threading
from collections.abc import Collection
from pathlib import Path
from typing import Self
from uuid import UUID

import zenoh

from bpn_shared.bus import keys
from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus
from bpn_shared.errors import one_line
from bpn_shared.messages import log_lines

log = logging.getLogger(__name__)

MAX_LINE_BYTES = 16 * 1024
MAX_FILE_BYTES = 64 * 1024 * 1024
"""Of one service's log in a run folder; what is said beyond is only in the service's own log."""
MAX_RUN_BYTES = 512 * 1024 * 1024
"""Of all services' together: each has an equal share."""

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029]")


class LogPublisher(logging.Handler):
    """While its context lasts, sends whatever the process logs to the run's learner, best effort."""

    def __init__(self, bus: Bus, run: UUID, service: str) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(log_lines.formatter(service))
        self._publisher = bus.zenoh.declare_publisher(
            keys.log(run, service),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.BACKGROUND,
        )

    def emit(self, record: logging.LogRecord) -> None:
        """Sends one record."""
        try:
            self._publisher.put(self.format(record).encode()[:MAX_LINE_BYTES])
        except zenoh.ZError:
            self.handleError(record)

    def __enter__(self) -> Self:
        logging.getLogger().addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger().removeHandler(self)
        self.close()

    def close(self) -> None:
        """Sends no more."""
        with contextlib.suppress(zenoh.ZError):  # the session has ended, and it with it
            self._publisher.undeclare()  # type: ignore[no-untyped-call]
        super().close()


class LogCollector(Declared):
    """Appends the log lines of a run's workers to the files of its folder.

    Any robot may send lines. So they are kept only under the names that the run has, each of which may fill its
    share of the disk and no more, and none of them looks like another service's.

    Lines that cannot be written, as on a full disk, are lost and counted; that is said once, as is the end of it.

    Args:
        services: names of the run's services.

    Attributes:
        lost: lines since the last one that could be written.
    """

    def __init__(self, bus: Bus, run: UUID, folder: Path, services: Collection[str]) -> None:
        super().__init__()
        self._folder, self._services = folder, frozenset(services)
        self._share_bytes = min(MAX_FILE_BYTES, MAX_RUN_BYTES // max(1, len(services)))
        self._lock = threading.Lock()
        self.lost = 0
        self._keep(bus.zenoh.declare_subscriber(keys.log(run, "*"), self._receive))

    def _receive(self, sample: zenoh.Sample) -> None:
        service = str(sample.key_expr).rsplit("/", 1)[-1]
        said = sample.payload.to_bytes()[:MAX_LINE_BYTES]
        if service not in self._services:  # it becomes a file name
            return
        with self._lock:
            try:
                self._append(service, as_said_by(service, said))
            except OSError as error:
                self.lost += 1
                if self.lost == 1:
                    log.error("log lines of workers are lost: %s", one_line(error))
            else:
                if self.lost:
                    log.warning("log lines of workers are kept again; %d were lost", self.lost)
                self.lost = 0

    def _append(self, service: str, lines: bytes) -> None:
        flags = (
            os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        )
        descriptor = os.open(self._folder / f"{service}.log", flags, 0o666)
        with os.fdopen(descriptor, "ab") as file:
            if file.tell() + len(lines) <= self._share_bytes:
                file.write(lines)


def as_said_by(service: str, said: bytes) -> bytes:
    """What a service said as whole lines of its own: nothing in it passes for a line of another one.

    The first line has the service's prefix, made up if it came without; a line that follows, as of a traceback,
    and has the form of a prefix is moved in. Control characters are shown as escapes.
    """
    text = said.decode("utf-8", "replace").rstrip("\n")
    first, *following = _CONTROL.sub(lambda found: repr(found[0])[1:-1], text).split("\n")
    if log_lines.parse(first).service != service:
        record = logging.LogRecord(service, logging.INFO, "", 0, first, None, None)
        first = log_lines.formatter(service).format(record)
    lines = [first]
    for line in following:
        lines.append(line if log_lines.parse(line).service is None else f"  {line}")
    return ("\n".join(lines) + "\n").encode()
