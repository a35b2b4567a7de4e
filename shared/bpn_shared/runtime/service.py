"""What every service does alike: logging, signals, counters, and saying what it waits for."""

import ctypes
import logging
import os
import queue
import re
import signal
import sys
import threading
import time
import uuid
from collections import Counter
from typing import TextIO

from bpn_shared.errors import one_line
from bpn_shared.messages import log_lines
from bpn_shared.version import PROTOCOL

log = logging.getLogger(__name__)

SUPERVISOR_PID = "BPN_SUPERVISOR_PID"
"""Environment variable: the process without which a service shall not run."""

_PROTOCOL_OF_ID = re.compile(r"[a-z-]+-p(\d{1,9})-[0-9a-f]{12}")
_PR_SET_PDEATHSIG = 1

MAX_FAULTS = 100
"""Kinds of exceptions that one service shows with their tracebacks."""


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


def new_worker_id(kind: str) -> str:
    """An id for this process; a restarted worker is another worker.

    It tells the protocol that the worker speaks, and so does every token that bears it.
    """
    return f"{kind.replace('_', '-')}-p{PROTOCOL}-{uuid.uuid4().hex[:12]}"


def protocol_of(worker: str) -> int | None:
    """The protocol that a worker's id tells; None: it tells none, as those of protocol 1."""
    told = _PROTOCOL_OF_ID.fullmatch(worker)
    return None if told is None else int(told[1])


class Counters:
    """Counts of what happened, safe across threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._faults: set[int] = set()

    def add(self, name: str, count: int = 1) -> int:
        """Adds to a counter and returns its new value."""
        with self._lock:
            self._counts[name] += count
            return self._counts[name]

    def refuse(self, name: str, reason: str) -> None:
        """Counts refused input; logs the 1st, 10th, 100th ... so that a flood cannot fill the log."""
        count = self.add(name)
        with self._lock:
            self._reasons.pop(name, None)  # the newest comes last
            self._reasons[name] = reason
        if count == 10 ** (len(str(count)) - 1):
            log.warning("%s (%s: %d so far)", reason, name, count)

    def fault(self, name: str, doing: str, error: Exception) -> None:
        """Counts an exception like refused input; the first of each kind is logged with its traceback.

        Of a kind are those of one type from one line.
        """
        place = error.__traceback__
        while place is not None and place.tb_next is not None:
            place = place.tb_next
        line = place and (place.tb_frame.f_code.co_filename, place.tb_lineno)
        kind = hash((name, type(error), line))
        with self._lock:
            is_new = kind not in self._faults and len(self._faults) < MAX_FAULTS
            if is_new:
                self._faults.add(kind)
        if is_new:
            log.error("%s failed: %s", doing, one_line(error), exc_info=error)
        self.refuse(name, f"{doing} failed: {one_line(error)}")

    def snapshot(self) -> dict[str, int]:
        with self._lock:
            return dict(self._counts)

    def reasons(self) -> dict[str, str]:
        """By counter, why the newest of what it counts was refused; the newest of all last."""
        with self._lock:
            return dict(self._reasons)


class Waiting:
    """What a service waits for: logged once when it changes, and part of its health report."""

    def __init__(self) -> None:
        self._what: str | None = None
        self._since_s = time.monotonic()
        self._obstacle: tuple[str, float] | None = None

    def set(self, what: str) -> None:
        """From now on the service waits for this."""
        if what != self._what:
            log.info("waiting for %s", what)
            self._what, self._since_s = what, time.monotonic()

    def done(self) -> None:
        """The service goes on."""
        if self._what is not None:
            log.info(
                "no longer waiting for %s (%.1f s)", self._what, time.monotonic() - self._since_s
            )
            self._what = None

    def obstruct(self, what: str | None) -> None:
        """Names what keeps the service from anything else, such as a lost router; None: nothing does.

        It is not logged: who knows it has said it.
        """
        self._obstacle = None if what is None else (what, time.monotonic())

    def snapshot(self) -> tuple[str | None, float]:
        """What the service waits for, and for how many seconds it has."""
        if (obstacle := self._obstacle) is not None:
            return obstacle[0], time.monotonic() - obstacle[1]
        what, since_s = self._what, self._since_s
        return what, time.monotonic() - since_s if what else 0.0
