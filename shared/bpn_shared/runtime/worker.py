"""What a worker is: a process that plays a role, and the place in a run where it plays it."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeVar
from uuid import UUID

from bpn_shared.backoff import Backoff
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.router_watch import RouterWatch
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryPublisher
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import Role
from bpn_shared.runs.config_file import decode_config
from bpn_shared.runtime.ask import OnRefusal, ask
from bpn_shared.runtime.telemetry import Latencies, Place, Reporter, WeightsTimeline
from bpn_shared.site import site_of
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.waiting import WaitStatus

EXIT_FINISHED, EXIT_FAILED, EXIT_UNRECOVERABLE = 0, 1, 2
Reply = TypeVar("Reply")


def service_name(kind: Role, slot: int) -> str:
    """What a worker is called in a run's logs; the learner of rank 0 is the run's learner."""
    return kind if kind == "learner" and slot == 0 else f"{kind}-{slot}"


def service_names(config: RunConfig) -> frozenset[str]:
    """What all workers of a run are called in its logs."""
    counts: dict[Role, int] = {
        "learner": config.learners, "edge": config.robots, "robot_sim": config.robots,
    }  # fmt: skip
    return frozenset(
        service_name(kind, slot) for kind, count in counts.items() for slot in range(count)
    )


@dataclass(frozen=True, kw_only=True)
class WorkerProcess:
    """What every worker has whether it works or is idle: its identity, and how it stops and counts."""

    kind: Role
    id: str
    bus: Bus
    stop: threading.Event
    counters: Counters = field(default_factory=Counters)
    waiting: WaitStatus = field(default_factory=WaitStatus)
    latencies: Latencies = field(default_factory=Latencies)
    weights: WeightsTimeline = field(default_factory=WeightsTimeline)
    router: RouterWatch | None = None
    holds_on_s: float | None = None
    """For how long it holds on to its place without a router; None: as long as it takes."""

    @property
    def site(self) -> str:
        """Where it is."""
        return site_of(self.id)

    @contextlib.contextmanager
    def holding(self, stop: threading.Event) -> Iterator[None]:
        """Sets `stop` if the router is lost for too long while the body, the work at a place, runs.

        Raises:
            RouterLostError: that happened.
        """
        if self.router is None or self.holds_on_s is None:
            yield
        else:
            with self.router.holding_for(self.holds_on_s, stop):
                yield

    @contextlib.contextmanager
    def announced(self, place: Place) -> Iterator[None]:
        """Tells the others that this worker lives, how it is, and answers for its health, while the body runs.

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
            certificate=lambda: None if self.router is None else self.router.certificate,
        )
        with (
            contextlib.closing(
                TelemetryPublisher(self.bus, self.kind, self.id, reporter.report, self.counters),
            ),
            Responder(self.bus, keys.health(self.kind, self.id), reporter.answer, self.counters),
            AliveToken(self.bus, self.kind, self.id),
        ):
            yield

    def ask(
        self,
        key: str,
        body: bytes,
        decode: Callable[[bytes], Reply],
        *,
        waiting_for: str,
        refused_as: str,
        on_refusal: OnRefusal | None = None,
        timeout_s: float = 2.0,
        backoff: Backoff | None = None,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> Reply | None:
        """Asks at `key` until there is an answer (`bus.ask.ask`); None if this worker was stopped.

        Args:
            refused_as: the counter of refusals.
            on_refusal: in place of counting them.
        """
        return ask(
            self.bus,
            key,
            body,
            decode,
            stop=self.stop,
            waiting=self.waiting,
            waiting_for=waiting_for,
            on_refusal=on_refusal
            or (lambda reason: self.counters.refuse(refused_as, f"asking {key}: {reason}")),
            timeout_s=timeout_s,
            backoff=backoff,
            meanwhile=meanwhile,
        )

    def at(self, run: UUID, slot: int, bus: Bus, stop: threading.Event) -> "Worker":
        """This worker at a place, with a session and an end that belong to the work there."""
        return Worker(
            run=run,
            slot=slot,
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
    """A worker at its place."""

    run: UUID
    slot: int


class WorkFailedError(ConfigError):
    """The work at a place failed in a way that nobody foresaw; the message is the exception's, in one line."""


WorkerMain = Callable[[Worker], int]
"""Does a worker's work until it is done or `stop` is set; returns the exit status."""


def fetch_config(worker: Worker) -> RunConfig | None:
    """Asks the run's learner for the configuration until it answers; None if the worker was stopped.

    Raises:
        ConfigError: the answer is no valid configuration.
    """
    answer = worker.ask(
        keys.config(worker.run),
        b"",
        bytes,
        waiting_for=f"the learner of run {worker.run} to tell the configuration",
        refused_as="configurations_refused",
    )
    if answer is None:
        return None
    worker.waiting.done()
    return decode_config(answer, source="the learner's configuration")
