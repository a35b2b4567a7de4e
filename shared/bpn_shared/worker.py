"""What a worker is: a process that plays a role, and the place in a run where it plays it."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from uuid import UUID

from bpn_shared import keys
from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.requests import NoReplyError, RefusedError, Responder, request
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryPublisher
from bpn_shared.config import RunConfig
from bpn_shared.messages.lease import Role
from bpn_shared.service import Counters, Waiting
from bpn_shared.telemetry import Latencies, Place, Reporter, WeightsMarks

EXIT_FINISHED, EXIT_FAILED, EXIT_UNRECOVERABLE = 0, 1, 2
_ASK_AGAIN_S = 0.1


def service_name(kind: Role, slot: int) -> str:
    """What a worker is called in a run's logs; the learner of rank 0 is the run's learner."""
    return kind if kind == "learner" and slot == 0 else f"{kind}-{slot}"


@dataclass(frozen=True, kw_only=True)
class WorkerProcess:
    """What every worker has whether it works or is idle: its identity, and how it stops and counts."""

    kind: Role
    id: str
    bus: Bus
    stop: threading.Event
    counters: Counters = field(default_factory=Counters)
    waiting: Waiting = field(default_factory=Waiting)
    latencies: Latencies = field(default_factory=Latencies)
    weights: WeightsMarks = field(default_factory=WeightsMarks)

    def announce(self, place: Place) -> tuple[AliveToken, Responder, TelemetryPublisher]:
        """Tells the others that this worker lives, how it is, and answers for its health.

        Args:
            place: answers with the run and slot that it works on now.
        """
        reporter = Reporter(
            self.kind,
            self.id,
            place,
            self.bus.traffic,
            waiting=self.waiting,
            counters=self.counters,
            latencies=self.latencies,
            weights=self.weights,
        )
        return (
            AliveToken(self.bus, self.kind, self.id),
            Responder(self.bus, keys.health(self.kind, self.id), reporter.answer, self.counters),
            TelemetryPublisher(self.bus, self.kind, self.id, reporter.report),
        )

    def at(
        self, run: UUID, slot: int, bus: Bus, stop: threading.Event, take_over: bool = False
    ) -> "Worker":
        """This worker at a place, with a session and an end that belong to the work there."""
        return Worker(
            run=run,
            slot=slot,
            take_over=take_over,
            bus=bus,
            stop=stop,
            kind=self.kind,
            id=self.id,
            counters=self.counters,
            waiting=self.waiting,
            latencies=self.latencies,
            weights=self.weights,
        )


@dataclass(frozen=True, kw_only=True)
class Worker(WorkerProcess):
    """A worker at its place.

    Attributes:
        take_over: of a learner: the registry orders it to dispossess the folder's owner, who is silent.
    """

    run: UUID
    slot: int
    take_over: bool = False


Serve = Callable[[Worker], int]
"""Does a worker's work until it is done or `stop` is set; returns the exit status."""


def fetch_config(worker: Worker) -> RunConfig | None:
    """Asks the run's learner for the configuration until it answers; None if the worker was stopped.

    Raises:
        ConfigError: the answer is no valid configuration.
    """
    while not worker.stop.is_set():
        try:
            answer = request(worker.bus, keys.config(worker.run), b"", timeout_s=2.0)
        except (NoReplyError, RefusedError):
            worker.waiting.set(f"the learner of run {worker.run} to tell the configuration")
            worker.stop.wait(_ASK_AGAIN_S)
            continue
        worker.waiting.done()
        return RunConfig.from_json(answer, source="the learner's configuration")
    return None
