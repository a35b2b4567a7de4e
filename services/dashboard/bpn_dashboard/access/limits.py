"""A limit on guesses at tokens."""

import threading
import time
from collections import OrderedDict, deque

_WINDOW_S = 60.0
_MAX_CLIENTS = 1024


class WrongTokens:
    """Counts each client's wrong tokens of the last minute; at the limit, it must wait.

    Args:
        limit: wrong tokens a minute.
    """

    def __init__(self, limit: int = 20) -> None:
        self._limit = limit
        self._lock = threading.Lock()
        self._times_s: OrderedDict[str, deque[float]] = OrderedDict()

    def wait_s(self, client: str) -> float:
        """How long this client must wait before it may try again; 0: it need not."""
        with self._lock:
            times_s = self._times_s.get(client)
            if times_s is None or len(times_s) < self._limit:
                return 0.0
            return max(0.0, times_s[0] + _WINDOW_S - time.monotonic())

    def add(self, client: str) -> None:
        """This client had a wrong one."""
        with self._lock:
            times_s = self._times_s.setdefault(client, deque(maxlen=self._limit))
            times_s.append(time.monotonic())
            self._times_s.move_to_end(client)
            if len(self._times_s) > _MAX_CLIENTS:
                self._times_s.popitem(last=False)
