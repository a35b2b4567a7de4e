"""What a session sent and received, by key: counts for whoever watches, cheap enough for the hot path."""

import threading

MAX_KEYS = 64
"""In each direction; the key that was used first is forgotten for a new one."""


class Tally:
    """Messages of one key in one direction. One thread counts, others read.

    Attributes:
        messages: sent or received, dropped ones included.
        bytes: of payloads.
        dropped: received but never looked at (a newer one came), or requests that nobody answered.
    """

    __slots__ = ("bytes", "dropped", "messages")

    def __init__(self) -> None:
        self.messages = self.bytes = self.dropped = 0

    def add(self, size_bytes: int) -> None:
        self.messages += 1
        self.bytes += size_bytes


class Traffic:
    """The tallies of one session."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sent: dict[str, Tally] = {}
        self._received: dict[str, Tally] = {}

    def sent(self, key: str) -> Tally:
        """The tally of what goes out at `key`."""
        return self._tally(self._sent, key)

    def received(self, key: str) -> Tally:
        """The tally of what comes in at `key`."""
        return self._tally(self._received, key)

    def _tally(self, tallies: dict[str, Tally], key: str) -> Tally:
        with self._lock:
            if key not in tallies and len(tallies) >= MAX_KEYS:
                del tallies[next(iter(tallies))]
            return tallies.setdefault(key, Tally())

    def snapshot(self) -> tuple[dict[str, Tally], dict[str, Tally]]:
        """What was sent and what was received, by key."""
        with self._lock:
            return dict(self._sent), dict(self._received)
