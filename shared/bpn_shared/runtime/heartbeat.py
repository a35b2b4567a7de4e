"""Two files that say how a service is, for checks that cost nothing.

A check that asks over the bus would start Python and open a session every few seconds in every container; looking
into a file does not. The first file says that the process is not stuck; whoever kills it for want of a heartbeat
must not do so because the router is away. The second, `.ready` at its end, says that the router is reached.

In the files is the time, as /proc/uptime tells it: a clock that nobody sets.
"""

import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path

from bpn_shared.closing import Closing
from bpn_shared.errors import one_line

log = logging.getLogger(__name__)

FILE_VARIABLE = "BPN_HEARTBEAT"
"""Environment variable: the file to write; without it there is no heartbeat."""
READY_SUFFIX = ".ready"
PERIOD_S = 1.0
_UPTIME = Path("/proc/uptime")
_WIDTH = 20


class Heartbeat(Closing):
    """Writes the time into the file once a second from a thread of its own, and into the second while ready.

    It stops with the process, and with one that is frozen.
    """

    def __init__(self, is_ready: Callable[[], bool] = lambda: True) -> None:
        named = os.environ.get(FILE_VARIABLE)
        self._file = Path(named) if named else None
        self._is_ready = is_ready
        self._failed = False
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        if self._file is not None:
            self._thread.start()

    def ready_when(self, is_ready: Callable[[], bool]) -> None:
        """From now on this says whether the service is ready."""
        self._is_ready = is_ready

    def _beat(self) -> None:
        assert self._file is not None  # else the thread is not started
        ready = self._file.with_name(self._file.name + READY_SUFFIX)
        while not self._closed.is_set():
            try:
                _write_time(self._file)
                if self._is_ready():
                    _write_time(ready)
                self._failed = False
            except OSError as error:  # a full disk: the service goes on, and so does this
                if not self._failed:
                    log.error("no heartbeat: %s", one_line(error))
                self._failed = True
            self._closed.wait(PERIOD_S)

    def close(self) -> None:
        """Ends the heartbeat."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()


def _write_time(path: Path) -> None:
    """In one write over the last one, so that a reader never finds an empty file."""
    uptime_s = _UPTIME.read_text(encoding="ascii").split()[0]
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        os.pwrite(descriptor, f"{uptime_s:<{_WIDTH}}\n".encode(), 0)
    finally:
        os.close(descriptor)
