"""Live metrics: best effort, because the truth is in the run folder."""

import logging
import time
from collections.abc import Callable, Mapping
from uuid import UUID

import zenoh

from bpn_shared.bus import keys
from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.metrics import MetricsBatch, Point

log = logging.getLogger(__name__)


class MetricsPublisher(Declared):
    """Publishes values that someone may be watching."""

    def __init__(self, bus: Bus, run: UUID, kind: str, worker: str) -> None:
        super().__init__()
        self._publisher = self._keep(
            bus.zenoh.declare_publisher(
                keys.metrics(run, kind, worker),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.BACKGROUND,
            )
        )
        self._sent = bus.traffic.sent(keys.metrics(run, kind, worker))

    def put(self, step: int, values: Mapping[str, float]) -> None:
        now_ns = time.time_ns()
        points = [Point(name=n, step=step, value=v, time_ns=now_ns) for n, v in values.items()]
        payload = MetricsBatch(points=points).encode()
        self._publisher.put(payload)
        self._sent.add(len(payload))


class MetricsSubscriber(Declared):
    """Calls `on_batch` with every batch of a run, on a thread of its own."""

    def __init__(self, bus: Bus, run: UUID, on_batch: Callable[[MetricsBatch], None]) -> None:
        super().__init__()
        self._on_batch = on_batch
        self._keep(bus.zenoh.declare_subscriber(keys.metrics(run, "*", "*"), self._receive))

    def _receive(self, sample: zenoh.Sample) -> None:
        try:
            self._on_batch(MetricsBatch.decode(sample.payload.to_bytes()))
        except MessageError as error:
            log.warning("metrics refused: %s", error)
