"""`bpn-learner`: hands out episodes, learns from them, publishes weights. Owns the run folder."""

import contextlib
import logging
from collections.abc import Mapping
from pathlib import Path

from bpn_learner.callbacks.extras import usable_callbacks
from bpn_learner.checkpoint import CheckpointError
from bpn_learner.episodes import DataError
from bpn_learner.evaluations import Evaluations
from bpn_learner.factory import has_gpu, name_of_gpu
from bpn_learner.group import GroupLostError
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.member import serve_member
from bpn_learner.refusals import EpisodeImpossibleError
from bpn_learner.rendezvous import Rendezvous
from bpn_learner.reward import function_of
from bpn_learner.storage import StorageError, StorageStopped, insist
from bpn_learner.training import Training
from bpn_learner.update import DivergenceError
from bpn_shared import plugins
from bpn_shared.bnn.weights import Weights
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import Alive
from bpn_shared.bus.logs import LogCollector
from bpn_shared.bus.metrics import MetricsPublisher
from bpn_shared.bus.requests import RefusedError, Responder
from bpn_shared.bus.router_watch import GIVE_UP_AFTER_S
from bpn_shared.bus.weights import WeightsPublisher
from bpn_shared.messages.control import Fault, NextEpisode
from bpn_shared.plugins import PluginError
from bpn_shared.runs.config_file import encode_config
from bpn_shared.runs.environment import Environment, write_environment
from bpn_shared.runs.folder import RunFolder, State
from bpn_shared.runs.ownership import Ownership
from bpn_shared.runtime.entry import argument_parser, natural, run_worker
from bpn_shared.runtime.leased import Abilities
from bpn_shared.runtime.watchdog import EPISODES_STORED, EPOCHS_DONE
from bpn_shared.runtime.worker import EXIT_FINISHED, EXIT_UNRECOVERABLE, Worker, service_names
from bpn_shared.spec.config import ConfigError
from bpn_shared.version import written_by

log = logging.getLogger(__name__)

_TELL_S = 2.0
"""How long a finished run's learner waits for its edges to ask once more, so that they are told."""


_HOPELESS = (
    CheckpointError,
    ConfigError,
    DataError,
    DivergenceError,
    EpisodeImpossibleError,
    GroupLostError,
    PluginError,
    StorageError,
)


def serve(worker: Worker, runs_dir: Path) -> int:
    """Trains the run from where its folder stands, until it is finished or the worker is stopped.

    A learner of rank 1 or above helps the one of rank 0, to whom the folder belongs.

    Raises:
        ConfigError: there is no such run.
        RunOwnedError: another learner works on it.
    """
    if worker.slot > 0:
        return serve_member(worker)
    folder = RunFolder.open(runs_dir, str(worker.run))
    with folder.owned(worker.id) as owner, _collected_logs(worker, folder):
        try:
            insist("the attempt", owner.begin_attempt, waiting=worker.waiting, stop=worker.stop)
            _train(worker, owner)
        except StorageStopped:
            return EXIT_FINISHED
        except _HOPELESS as error:
            log.error("%s", error)  # it would come again
            _say_failed(owner, str(error))
            return EXIT_UNRECOVERABLE
    return EXIT_FINISHED


def _say_failed(owner: Ownership, error: str) -> None:
    """As far as the disk lets it; the log has the reason in any case."""
    try:
        owner.set_state("failed", error=error)
    except (OSError, ConfigError) as why:
        log.error("the run's state cannot be written: %s", why)


def _note_environment(owner: Ownership, worker: str) -> None:
    """Where and with what the attempt is made. A run whose disk is full goes on without."""
    try:
        here = Environment.here(owner.attempt, worker, name_of_gpu())
        write_environment(owner.folder, here, prove=owner.prove)
    except OSError as error:
        log.warning("the environment of attempt %d is not written down: %s", owner.attempt, error)


def _collected_logs(worker: Worker, folder: RunFolder) -> contextlib.AbstractContextManager[object]:
    """Keeps what the run's other workers say."""
    try:
        services = service_names(folder.config())
    except ConfigError:  # which who reads it next says
        return contextlib.nullcontext()
    return LogCollector(worker.bus, worker.run, folder.logs, services)


def _train(worker: Worker, owner: Ownership) -> None:
    config = owner.folder.config()
    function_of(config.task_spec)  # what is not installed here is said before anybody plays
    program = " ".join(f"{name} {value}" for name, value in written_by().items() if value)
    log.info("attempt %d: %s, %s (%s)", owner.attempt, config.algorithm, config.task, program)
    _note_environment(owner, worker.id)
    alive = Alive(worker.bus, "edge")
    ledger = EpisodeLedger(config, owner, alive, worker.waiting, worker.counters)

    evaluations = Evaluations(config, alive, worker.waiting, prove=owner.prove)

    def next_episode(body: bytes) -> bytes:
        asked = NextEpisode.decode(body)
        return (evaluations.next(asked) or ledger.next(asked)).encode()

    def episode(body: bytes) -> bytes:
        try:
            receipt = evaluations.receive(body) or ledger.receive(body)
        except StorageError as error:
            raise RefusedError(str(error)) from error
        worker.counters.add(EPISODES_STORED, receipt.status == "stored")
        return receipt.encode()

    def fault(body: bytes) -> bytes:
        told = Fault.decode(body)
        return (evaluations.fault(told) or ledger.fault(told)).encode()

    def configuration(_body: bytes) -> bytes:
        return encode_config(config)

    weights = WeightsPublisher(worker.bus, worker.run)

    def publish(released: Weights) -> None:
        # Noted before it is sent: an edge may have loaded it while we still send.
        worker.weights.record("published", released)
        weights.publish(released)

    metrics = MetricsPublisher(worker.bus, worker.run, "learner", worker.id)

    def report(iteration: int, values: Mapping[str, float]) -> None:
        worker.counters.add(EPOCHS_DONE, "progress.epochs" in values)
        metrics.put(iteration, values)

    responders = [
        Responder(worker.bus, keys.config(worker.run), configuration, worker.counters),
        Responder(worker.bus, keys.next_episode(worker.run), next_episode, worker.counters),
        Responder(worker.bus, keys.episode(worker.run), episode, worker.counters),
        Responder(worker.bus, keys.fault(worker.run), fault, worker.counters),
    ]
    training = Training(
        config,
        owner,
        ledger,
        publish=publish,
        rendezvous=Rendezvous(worker, config) if config.learners > 1 else None,
        report=report,
        waiting=worker.waiting,
        stop=worker.stop,
        evaluations=evaluations,
        counters=worker.counters,
    )
    finished = training.run()
    end: State = "finished" if finished else "stopped"
    insist(
        "the state",
        lambda: owner.set_state(end, error=training.ended_early),
        waiting=worker.waiting,
        stop=worker.stop,
    )
    if finished:
        ledger.finish()
        ledger.wait_told(worker.stop, _TELL_S)
    del responders


def main(argv: list[str] | None = None) -> int:
    """The learner service."""
    parser = argument_parser("learner", __doc__)
    parser.add_argument(
        "--runs-dir", type=Path, default=Path("runs"), help="where run folders are (default runs)"
    )
    parser.add_argument(
        "--slot", type=natural, default=0,
        help="rank among the run's learners; 0 (default) is the one that owns the run folder",
    )  # fmt: skip
    parser.add_argument(
        "--give-up-after", type=float, metavar="SECONDS", default=GIVE_UP_AFTER_S,
        help="how long without the router until the run is left to other learners (default %(default)s)",
    )  # fmt: skip
    options = parser.parse_args(argv)
    if not options.give_up_after > 0:
        parser.error(f"--give-up-after {options.give_up_after} must be above 0")
    return run_worker(
        "learner",
        options,
        lambda worker: serve(worker, options.runs_dir),
        holds_on_s=options.give_up_after,
        abilities=Abilities(
            gpu=has_gpu(),
            plugins={
                plugins.CALLBACKS.name: usable_callbacks(),
                plugins.REWARDS.name: plugins.names(plugins.REWARDS),
                plugins.TARGETS.name: plugins.names(plugins.TARGETS),
            },
        ),
    )
