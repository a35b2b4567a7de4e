"""A file that is touched while a service is well, for health checks that cost nothing.

A check that asks over the bus would start Python and open a session every few seconds in every container;
looking at a file's time does not.
"""

import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Self

log = logging.getLogger(__name__)

FILE_VARIABLE = "BPN_HEARTBEAT"
"""Environment variable: the file to touch; without it there is no heartbeat."""
PERIOD_S = 1.0


class Heartbeat:
    """Touches the file once a second from a thread of its own, while `is_well` says so.

    So it stops with the process, with a process that is frozen, and with a session that lost its router.
    """

    def __init__(self, is_well: Callable[[], bool] = lambda: True) -> None:
        named = os.environ.get(FILE_VARIABLE)
        self._file = Path(named) if named else None
        self._is_well = is_well
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        if self._file is not None:
            self._thread.start()

    def _beat(self) -> None:
        assert self._file is not None  # else the thread is not started
        while not self._closed.is_set():
            if self._is_well():
                try:
                    self._file.touch()
                except OSError as error:
                    log.error("no heartbeat: %s", error)
                    return
            self._closed.wait(PERIOD_S)

    def close(self) -> None:
        """Ends the heartbeat."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
