"""The frame of a worker that is told its place by flags: robot and edge start, wait and stop alike."""

import argparse
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from uuid import UUID

from bpn_shared import keys
from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.requests import NoReplyError, RefusedError, Responder, request
from bpn_shared.bus.session import DEFAULT_ENDPOINT, Bus, BusError
from bpn_shared.bus.telemetry import TelemetryPublisher
from bpn_shared.config import ConfigError, RunConfig
from bpn_shared.service import (
    Counters,
    Waiting,
    end_with_supervisor,
    new_worker_id,
    set_up_logging,
    stop_on_signals,
)
from bpn_shared.telemetry import Latencies, Reporter, WeightsMarks

log = logging.getLogger(__name__)

EXIT_FINISHED, EXIT_FAILED, EXIT_UNRECOVERABLE = 0, 1, 2
_ASK_AGAIN_S = 0.1


@dataclass(frozen=True)
class Worker:
    """What every worker has: its identity, its session, and how it stops, waits and counts."""

    kind: str
    run: UUID
    slot: int
    bus: Bus
    stop: threading.Event
    counters: Counters = field(default_factory=Counters)
    waiting: Waiting = field(default_factory=Waiting)
    latencies: Latencies = field(default_factory=Latencies)
    weights: WeightsMarks = field(default_factory=WeightsMarks)
    id: str = ""

    def announce(self) -> tuple[AliveToken, Responder, TelemetryPublisher]:
        """Tells the others that this worker lives, how it is, and answers for its health."""
        reporter = Reporter(
            self.kind,
            self.id,
            lambda: (self.run, self.slot),
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


def argument_parser(kind: str, description: str | None) -> argparse.ArgumentParser:
    """The options that every service has."""
    parser = argparse.ArgumentParser(prog=f"bpn-{kind.replace('_', '-')}", description=description)
    parser.add_argument("--run", type=UUID, required=True, help="id of the run")
    parser.add_argument(
        "--connect", default=DEFAULT_ENDPOINT, help="the router's endpoint (default %(default)s)"
    )
    return parser


def run_service(
    kind: str, options: argparse.Namespace, serve: Callable[[Worker], int], slot: int = 0
) -> int:
    """Sets up logging, signals and session, announces the worker, serves, and closes again.

    Returns:
        The exit status: what `serve` returns; `EXIT_UNRECOVERABLE` for errors that a restart cannot mend.
    """
    set_up_logging(f"{kind}-{slot}")
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        with Bus(options.connect, stop=stop) as bus:
            worker = Worker(kind, options.run, slot, bus, stop, id=new_worker_id(kind))
            announced = worker.announce()
            log.info("%s serves run %s, slot %d", worker.id, options.run, slot)
            status = serve(worker)
            del announced
            return status
    except BusError as error:
        log.error("%s", error)
        return EXIT_FINISHED if stop.is_set() else EXIT_FAILED
    except ConfigError as error:
        log.error("%s", error)
        return EXIT_UNRECOVERABLE


def run_slot_worker(
    kind: str,
    description: str | None,
    serve: Callable[[Worker, RunConfig], int],
    argv: list[str] | None = None,
) -> int:
    """Runs a worker of one slot, which gets its configuration from the run's learner."""
    parser = argument_parser(kind, description)
    parser.add_argument("--slot", type=int, required=True, help="which robot of the run, from 0")
    options = parser.parse_args(argv)

    def serve_configured(worker: Worker) -> int:
        config = fetch_config(worker)
        return EXIT_FINISHED if config is None else serve(worker, config)

    return run_service(kind, options, serve_configured, options.slot)


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
