"""Streams for whoever watches: a sample of what happens, which costs nothing while nobody does.

The one who has something to show only leaves it; encoding and sending are another thread's, which sleeps
while nobody subscribes.
"""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh

from bpn_shared.bus.session import Bus
from bpn_shared.bus.signal import Signal
from bpn_shared.counters import Counters

Item = TypeVar("Item")
Encode = Callable[[Item], tuple[bytes, bytes | None]]
"""From an item to payload and attachment; called on the sending thread."""


class SampledPublisher(Generic[Item]):
    """Publishes the newest of what it is offered, at most `rate_hz` times a second, until it or its session is
    closed.

    One thread offers.

    Args:
        counters: `items_not_published` is counted here.

    Attributes:
        has_subscribers: whether anybody subscribes; no use offering otherwise.
    """

    def __init__(
        self, bus: Bus, key: str, rate_hz: float, encode: Encode[Item], counters: Counters
    ) -> None:
        self._period_s, self._encode, self._counters = 1 / rate_hz, encode, counters
        self._item: Item | None = None
        self._news = Signal()
        self._closed = threading.Event()
        self._sent = bus.traffic.sent(key)
        self._publisher = bus.zenoh.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.BACKGROUND,
        )
        self.has_subscribers = False
        self._listener = self._publisher.declare_matching_listener(
            zenoh.handlers.Callback(self._changed, indirect=False)
        )
        # `matching_status` is an object that is always true; what counts is its `matching`
        self.has_subscribers = bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]
        self._thread = threading.Thread(target=self._publish, name=f"sampled {key}", daemon=True)
        self._thread.start()
        bus.before_close(self.close)

    def _changed(self, status: "zenoh.MatchingStatus") -> None:
        self.has_subscribers = bool(status.matching)

    def publish_latest(self, item: Item) -> None:
        """Leaves an item to be published, instead of an older one that is not published yet."""
        if self.has_subscribers:
            self._item = item
            self._news.tell()

    def _publish(self) -> None:
        while True:
            self._news.wait()
            item, self._item = self._item, None
            if self._closed.is_set():
                return
            if item is None:  # taken just before it was announced
                continue
            try:
                payload, attachment = self._encode(item)
                self._publisher.put(payload, attachment=attachment)
                self._sent.add(len(payload))
            except Exception as error:
                doing = f"publishing at {self._publisher.key_expr}"
                self._counters.fault("items_not_published", doing, error)
            self._closed.wait(self._period_s)

    def close(self) -> None:
        """Stops publishing. Nothing may be offered any more; closing it again does nothing."""
        if self._closed.is_set():
            return
        self.has_subscribers = False
        self._closed.set()
        self._news.tell()
        self._thread.join()
        self._listener.undeclare()  # type: ignore[no-untyped-call]
        self._publisher.undeclare()  # type: ignore[no-untyped-call]
