"""Streams where only the newest matters: frames and actions."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import zenoh

from bpn_shared.bus.session import Bus

_PRIORITIES = {"frame": zenoh.Priority.DATA_HIGH, "action": zenoh.Priority.REAL_TIME}


@dataclass(frozen=True, slots=True)
class Sample:
    """One received message; `t_receive_ns` is this process's monotonic clock."""

    attachment: bytes
    payload: bytes
    t_receive_ns: int


class LatestPublisher:
    """Sends without ever blocking: what cannot go at once is dropped (the receiver wants only the newest)."""

    def __init__(self, bus: Bus, key: str, kind: Literal["frame", "action"]) -> None:
        self._publisher = bus.zenoh.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=_PRIORITIES[kind],
            express=True,
        )

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        self._publisher.put(payload, attachment=attachment)


class LatestSubscriber:
    """A slot with the newest message; older ones that nobody took are gone and counted."""

    def __init__(self, bus: Bus, key: str) -> None:
        self._changed = threading.Condition()
        self._sample: Sample | None = None
        self.overwritten = 0
        # A direct callback runs on the network thread, so it must only copy (a slow one delays every
        # subscriber of the session); the default handler would queue 256 stale frames instead.
        handler = zenoh.handlers.Callback(self._receive, indirect=False)
        self._subscriber = bus.zenoh.declare_subscriber(key, handler)

    def _receive(self, sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        attachment = sample.attachment.to_bytes() if sample.attachment is not None else b""
        received = Sample(attachment, sample.payload.to_bytes(), now_ns)
        with self._changed:
            self.overwritten += self._sample is not None
            self._sample = received
            self._changed.notify_all()

    def take(
        self, timeout_s: float, interrupted: Callable[[], bool] = lambda: False
    ) -> Sample | None:
        """The newest message that nobody took yet.

        Returns:
            None if none comes within the timeout, or if `interrupted()` is true, which is looked at now
            and at every `wake`.
        """
        with self._changed:
            if self._sample is None:
                self._changed.wait_for(lambda: self._sample is not None or interrupted(), timeout_s)
            sample, self._sample = self._sample, None
            return sample

    def wake(self) -> None:
        """Makes a waiting `take` look at its `interrupted` again."""
        with self._changed:
            self._changed.notify_all()
