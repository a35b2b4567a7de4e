"""A registry on a real router, and workers whose every move the test makes."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.dispatcher import Dispatcher
from bpn_dashboard.registry.store import RunStore
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import AliveToken, Token
from bpn_shared.bus.requests import Responder, request
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import LeaseReply, LeaseRequest, Release, ReleaseReply, Role
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.version import PROTOCOL, VERSION

WaitFor = Callable[..., None]


@dataclass
class Registry:
    """A registry that can be ended and begun again."""

    store: RunStore
    open_bus: Callable[[], Bus]
    running: Dispatcher | None = None

    def begin(self) -> None:
        self.bus = self.open_bus()
        self.counters = Counters()
        self.running = Dispatcher(self.bus, self.store, self.counters)
        self.running.start()

    def end(self) -> None:
        if self.running is not None:
            self.running.close()
            self.bus.close()
            self.running = None


@dataclass
class Puppet:
    """A worker whose every move the test makes."""

    role: Role
    id: str
    open_bus: Callable[[], Bus]
    released: list[Release] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.bus = self.open_bus()
        self.alive = AliveToken(self.bus, self.role, self.id)
        key = keys.control(self.role, self.id)
        self.control = Responder(self.bus, key, self._release, Counters())

    def _release(self, body: bytes) -> bytes:
        self.released.append(Release.decode(body))
        return ReleaseReply(working=True).encode()

    def ask(self, **more: Any) -> LeaseReply:
        given = {"role": self.role, "worker": self.id, "protocol": PROTOCOL} | more
        body = LeaseRequest(**given).encode()
        return LeaseReply.decode(request(self.bus, keys.lease_request(), body, timeout_s=5.0))

    def take(self, lease: LeaseReply) -> None:
        assert lease.run is not None
        self.work_bus = self.open_bus()
        key = keys.lease(lease.run, self.role, lease.slot, self.id)
        self.token = Token(self.work_bus, key)

    def report(self, run: str | None, **more: Any) -> None:
        """Tells once how it is, as services do every second."""
        values: dict[str, Any] = {
            "kind": self.role, "worker": self.id, "run": run, "slot": 0, "host": "h", "clock": "c",
            "pid": 1, "time_ns": time.time_ns(), "uptime_s": 1.0, "waiting_for": None, "waiting_s": 0.0,
            "cpu_percent": 0.0, "rss_bytes": 0, "counters": {}, "weights": {}, "latencies": {},
            "traffic": [], "version": VERSION, "protocol": PROTOCOL,
        }  # fmt: skip
        report = Telemetry(**(values | more))
        self.bus.zenoh.put(keys.telemetry(self.role, self.id), report.encode())

    def give_back(self) -> None:
        self.work_bus.close()

    def die(self) -> None:
        self.bus.close()
        self.work_bus.close()

    def work(self, wait_for: WaitFor) -> LeaseReply:
        """Asks until there is a lease, and takes it."""
        answers: list[LeaseReply] = []

        def granted() -> bool:
            answers.append(self.ask())
            return answers[-1].run is not None

        wait_for(granted, f"a lease for {self.id}")
        self.take(answers[-1])
        return answers[-1]


def state_of(registry: Registry, row: RunRow) -> str:
    return registry.store.get(row.id).state
