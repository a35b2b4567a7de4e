"""The dashboard as one of the services: alive, and telling how it is like all others."""

from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryPublisher
from bpn_shared.counters import Counters
from bpn_shared.runtime.telemetry import Latencies, Reporter, WeightsTimeline
from bpn_shared.waiting import WaitStatus

KIND = "dashboard"


class Presence:
    """A liveliness token and telemetry, until it is closed."""

    def __init__(self, bus: Bus, name: str, counters: Counters, waiting: WaitStatus) -> None:
        reporter = Reporter(
            KIND,
            name,
            lambda: (None, None),
            bus.traffic,
            waiting=waiting,
            counters=counters,
            latencies=Latencies(),
            weights=WeightsTimeline(),
        )
        self._token = AliveToken(bus, KIND, name)
        self._telemetry = TelemetryPublisher(bus, KIND, name, reporter.report, counters)

    def close(self) -> None:
        """Ends the telemetry; the token goes with the session."""
        self._telemetry.close()
