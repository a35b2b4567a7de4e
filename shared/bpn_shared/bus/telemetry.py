"""How services are, once a second: sent while anyone listens, received by who shows it."""

import threading
from collections.abc import Callable

import zenoh

from bpn_shared.bus import keys
from bpn_shared.bus.session import Bus
from bpn_shared.bus.watch import Subscriber
from bpn_shared.counters import Counters
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.telemetry import Telemetry

PERIOD_S = 1.0


class TelemetryPublisher:
    """Sends a service's report every second and when it ends, at the latest when its session does.

    Args:
        counters: `reports_failed` is counted here.
    """

    def __init__(
        self, bus: Bus, kind: str, worker: str, report: Callable[[], Telemetry], counters: Counters
    ) -> None:
        self._report, self._counters = report, counters
        self._closed = threading.Event()
        self._publisher = bus.zenoh.declare_publisher(
            keys.telemetry(kind, worker),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.BACKGROUND,
        )
        self._thread = threading.Thread(target=self._publish, name="telemetry", daemon=True)
        self._thread.start()
        bus.before_close(self.close)

    def _publish(self) -> None:
        while not self._closed.is_set():
            self._send()
            self._closed.wait(PERIOD_S)
        self._send()  # a run of a second or two is told in full

    def _send(self) -> None:
        try:
            if self._publisher.matching_status.matching:  # type: ignore[attr-defined]
                self._publisher.put(self._report().encode())
        except Exception as error:
            self._counters.fault("reports_failed", "a telemetry report", error)

    def close(self) -> None:
        """Sends what is so far, and no more. Closing it again does nothing."""
        self._closed.set()
        self._thread.join()


class TelemetryWatch:
    """Calls `on_report` with every report of every service, on the network thread.

    Args:
        counters: `telemetry_refused` is counted here.
    """

    def __init__(
        self, bus: Bus, on_report: Callable[[Telemetry], None], counters: Counters
    ) -> None:
        def receive(_attachment: bytes, payload: bytes) -> None:
            try:
                on_report(Telemetry.decode(payload))
            except MessageError as error:
                counters.refuse("telemetry_refused", str(error))

        self._watch = Subscriber(bus, keys.telemetry("*", "*"), receive)

    def close(self) -> None:
        self._watch.close()
