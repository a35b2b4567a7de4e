"""What happened in a service, and how often: counted, and of what was refused the newest reason."""

import logging
import threading
from collections import Counter

from bpn_shared.errors import one_line

log = logging.getLogger(__name__)

MAX_FAULTS = 100
"""Kinds of exceptions that one service shows with their tracebacks."""


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
