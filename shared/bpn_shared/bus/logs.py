"""Log lines of workers that do not share the run folder, on their way there."""

import logging
import re
import threading
from pathlib import Path
from types import TracebackType
from typing import Self
from uuid import UUID

import zenoh

from bpn_shared import keys, log_lines
from bpn_shared.bus.session import Bus

MAX_LINE_BYTES = 16 * 1024
MAX_FILE_BYTES = 64 * 1024 * 1024
"""Of one service's log in a run folder; what is said beyond is only in the service's own log."""

_SERVICE = re.compile(r"[a-z_]+(-[0-9]+)?")


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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        logging.getLogger().removeHandler(self)


class LogCollector:
    """Appends the log lines of a run's workers to the files of its folder, until the session ends."""

    def __init__(self, bus: Bus, run: UUID, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._subscriber = bus.zenoh.declare_subscriber(keys.log(run, "*"), self._receive)

    def _receive(self, sample: zenoh.Sample) -> None:
        service = str(sample.key_expr).rsplit("/", 1)[-1]
        line = sample.payload.to_bytes()[:MAX_LINE_BYTES]
        if not _SERVICE.fullmatch(service):  # it becomes a file name
            return
        with self._lock, (self._folder / f"{service}.log").open("ab") as file:
            if file.tell() < MAX_FILE_BYTES:
                file.write(line.rstrip(b"\n") + b"\n")
