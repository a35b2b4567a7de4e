"""Streams where only the newest matters: frames and actions.

Two ways to receive. `LatestSubscriber` is a slot that some thread takes from. `DirectSubscriber` calls a
handler on the network thread, which saves waking another one (about 80 us where cores go idle between
frames) but delays everything else that the session receives: it is for work far shorter than a frame's
period.
"""

import threading
import time
from collections.abc import Callable
from typing import Literal, NamedTuple

import zenoh

from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus
from bpn_shared.bus.signal import Signal
from bpn_shared.bus.traffic import Tally

_PRIORITIES = {"frame": zenoh.Priority.DATA_HIGH, "action": zenoh.Priority.REAL_TIME}


class Sample(NamedTuple):
    """One received message.

    Attributes:
        t_receive_ns: this process's monotonic clock.
        is_local: whether it came past the router (`bpn_shared.bus.local_link`).
    """

    attachment: bytes
    payload: bytes
    t_receive_ns: int
    is_local: bool = False


class LatestPublisher(Declared):
    """Sends without ever blocking: what cannot go at once is dropped (the receiver wants only the newest).

    Not `express`, which sounds right: a message that may be batched leaves as soon as the link is free all
    the same, and camera to action was 12 % shorter (medians 340 against 392 us in alternating rounds).
    """

    def __init__(self, bus: Bus, key: str, kind: Literal["frame", "action"]) -> None:
        super().__init__()
        self._publisher = self._keep(
            bus.zenoh.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=_PRIORITIES[kind],
            )
        )
        self._sent = bus.traffic.sent(key)

    def put(self, payload: bytes, attachment: bytes | None = None) -> None:
        self._publisher.put(payload, attachment=attachment)
        self._sent.add(len(payload))


OnMessage = Callable[[bytes, bytes, int], None]
"""Takes a message: attachment, payload, and when it came (this process's monotonic clock, ns)."""


class DirectSubscriber(Declared):
    """Calls `handler` with every message, one after the other, on the network thread.

    What the handler raises is only logged by Zenoh, so it should raise nothing.
    """

    def __init__(self, bus: Bus, key: str, handler: OnMessage) -> None:
        super().__init__()
        tally = bus.traffic.received(key)

        def receive(sample: zenoh.Sample) -> None:
            now_ns = time.monotonic_ns()
            attachment = sample.attachment
            header = b"" if attachment is None else attachment.to_bytes()
            payload = sample.payload.to_bytes()
            handler(header, payload, now_ns)
            tally.add(len(payload))

        self._keep(
            bus.zenoh.declare_subscriber(key, zenoh.handlers.Callback(receive, indirect=False))
        )


class LatestSlot:
    """The newest message of those that anyone puts here; older ones that nobody took are gone. One thread takes.

    Args:
        tally: where messages that nobody took are counted.
    """

    def __init__(self, tally: Tally) -> None:
        self._lock = threading.Lock()
        self._sample: Sample | None = None
        self._news = Signal()
        self._tally = tally
        self.received = 0
        """Messages so far, taken or not."""

    def put(self, sample: Sample) -> None:
        """Leaves a message instead of an older one."""
        with self._lock:
            if self._sample is not None:
                self._tally.dropped += 1
            self._sample = sample
            self.received += 1
        self._news.tell()

    def wake(self) -> None:
        """Makes `take` return at once, the one that waits now or the next one."""
        self._news.tell()

    def take(self, timeout_s: float) -> Sample | None:
        """The newest message that nobody took yet; None if none came within the timeout, or after `wake`."""
        self._news.wait(timeout_s)
        with self._lock:
            sample, self._sample = self._sample, None
            return sample


class LatestSubscriber(LatestSlot):
    """A slot with the newest message of a key."""

    def __init__(self, bus: Bus, key: str) -> None:
        super().__init__(bus.traffic.received(key))
        # The default handler would queue 256 stale frames instead of keeping the newest.
        self._subscriber = DirectSubscriber(bus, key, lambda *message: self.put(Sample(*message)))

    def close(self) -> None:
        """Takes in no more."""
        self._subscriber.close()
