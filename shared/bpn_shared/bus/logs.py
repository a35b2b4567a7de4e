"""Log lines of workers that do not share the run folder, on their way there."""

import contextlib
import logging
import re
import threading
from pathlib import Path
from types import TracebackType
from typing import Self
from uuid import UUID

import zenoh

from bpn_shared import keys, log_lines
from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus
from bpn_shared.errors import one_line

log = logging.getLogger(__name__)

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
        self.close()

    def close(self) -> None:
        """Sends no more."""
        with contextlib.suppress(zenoh.ZError):  # the session has ended, and it with it
            self._publisher.undeclare()  # type: ignore[no-untyped-call]
        super().close()


class LogCollector(Declared):
    """Appends the log lines of a run's workers to the files of its folder.

    Lines that cannot be written, as on a full disk, are lost and counted; that is said once, as is the end of it.

    Attributes:
        lost: lines since the last one that could be written.
    """

    def __init__(self, bus: Bus, run: UUID, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self._lock = threading.Lock()
        self.lost = 0
        self._keep(bus.zenoh.declare_subscriber(keys.log(run, "*"), self._receive))

    def _receive(self, sample: zenoh.Sample) -> None:
        service = str(sample.key_expr).rsplit("/", 1)[-1]
        line = sample.payload.to_bytes()[:MAX_LINE_BYTES]
        if not _SERVICE.fullmatch(service):  # it becomes a file name
            return
        with self._lock:
            try:
                self._append(self._folder / f"{service}.log", line.rstrip(b"\n") + b"\n")
            except OSError as error:
                self.lost += 1
                if self.lost == 1:
                    log.error("log lines of workers are lost: %s", one_line(error))
            else:
                if self.lost:
                    log.warning("log lines of workers are kept again; %d were lost", self.lost)
                self.lost = 0

    @staticmethod
    def _append(path: Path, line: bytes) -> None:
        with path.open("ab") as file:
            if file.tell() < MAX_FILE_BYTES:
                file.write(line)
