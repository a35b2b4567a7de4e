"""What every service does alike: its log, its signals, its id, and its end."""

import ctypes
import logging
import os
import queue
import re
import signal
import sys
import threading
import uuid
from typing import TextIO

from bpn_shared.errors import one_line
from bpn_shared.messages import log_lines
from bpn_shared.site import MAIN_SITE, prefix_of
from bpn_shared.version import PROTOCOL

log = logging.getLogger(__name__)

SUPERVISOR_PID = "BPN_SUPERVISOR_PID"
"""Environment variable: the process without which a service shall not run."""

_PROTOCOL_OF_ID = re.compile(r"(?:[a-z0-9-]+\.)?[a-z-]+-p(\d{1,9})-[0-9a-f]{12}")
_PR_SET_PDEATHSIG = 1


class _SurvivingHandler(logging.StreamHandler[TextIO]):
    """Goes on when lines cannot be written, as on a full disk; other handlers hear of it once, this one later."""

    _lost = 0
    _reason = ""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: ARG002 - the name is logging's
        """Counts the line."""
        self._lost += 1
        self._reason = one_line(sys.exc_info()[1] or OSError("the log cannot be written"))
        if self._lost == 1:
            log.error("log lines are lost: %s", self._reason)  # comes here too, and is counted

    def emit(self, record: logging.LogRecord) -> None:
        """Writes one line, and after it that others are missing, if they are."""
        lost = self._lost
        super().emit(record)
        if lost and self._lost == lost:
            self._lost = 0
            said = f"log lines were lost, up to {lost}: {self._reason}"
            super().emit(logging.makeLogRecord({"levelname": "ERROR", "msg": said}))


def set_up_logging(service: str) -> None:
    """Log lines to standard error, in the form of `bpn_shared.messages.log_lines`."""
    handler = _SurvivingHandler()
    handler.setFormatter(log_lines.formatter(service))
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)


def stop_on_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set; a second SIGINT ends the process at once.

    The handler only puts into a SimpleQueue, whose `put` is reentrant. Setting the event in it could
    deadlock: it runs between two bytecodes of the main thread, which may hold the event's lock just then.
    """
    stop = threading.Event()
    signals: queue.SimpleQueue[int] = queue.SimpleQueue()

    def watch() -> None:
        interrupts = 0
        while True:
            number = signals.get()
            stop.set()
            interrupts += number == signal.SIGINT
            if interrupts > 1:
                os._exit(128 + number)

    threading.Thread(target=watch, name="signals", daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: signals.put(received))
    return stop


def end_with_supervisor() -> None:
    """Asks the kernel for SIGTERM when the supervisor that started this process is gone (Linux)."""
    supervisor = os.environ.get(SUPERVISOR_PID)
    if supervisor is None:
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(supervisor):  # it died before we asked
        os.kill(os.getpid(), signal.SIGTERM)


def new_worker_id(kind: str, site: str = MAIN_SITE) -> str:
    """An id for this process; a restarted worker is another worker.

    It tells the worker's site and the protocol that it speaks, and so does every token that bears it.
    """
    return f"{prefix_of(site)}{kind.replace('_', '-')}-p{PROTOCOL}-{uuid.uuid4().hex[:12]}"


def protocol_of(worker: str) -> int | None:
    """The protocol that a worker's id tells; None: it tells none, as those of protocol 1."""
    told = _PROTOCOL_OF_ID.fullmatch(worker)
    return None if told is None else int(told[1])
