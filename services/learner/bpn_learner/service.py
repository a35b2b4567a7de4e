"""`bpn-learner`: hands out episodes, learns from them, publishes weights. Owns the run folder."""

import argparse
import logging
from pathlib import Path

from bpn_learner.checkpoint import CheckpointError
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.reward import RewardError
from bpn_learner.training import Training
from bpn_learner.update import DivergenceError
from bpn_shared import keys
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bus.liveliness import Alive
from bpn_shared.bus.metrics import MetricsPublisher
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.weights import WeightsPublisher
from bpn_shared.messages.control import NextEpisode
from bpn_shared.run_folder import RunFolder
from bpn_shared.worker import (
    EXIT_FINISHED,
    EXIT_UNRECOVERABLE,
    Worker,
    argument_parser,
    run_service,
)

log = logging.getLogger(__name__)

_LINGER_S = 2.0


def serve(worker: Worker, runs_dir: Path) -> int:
    """Trains the run from where its folder stands, until it is finished or the worker is stopped."""
    folder = RunFolder.open(runs_dir, str(worker.run))
    config = folder.config()
    state = folder.set_state("running", new_attempt=True)
    log.info("attempt %d: %s, %s", state.attempt, config.algorithm, config.task)
    edges = Alive(worker.bus, "edge")
    ledger = EpisodeLedger(config, folder, edges)

    def next_episode(body: bytes) -> bytes:
        return ledger.next(NextEpisode.decode(body)).encode()

    def episode(body: bytes) -> bytes:
        return ledger.receive(body).encode()

    def configuration(_body: bytes) -> bytes:
        return config.model_dump_json().encode()

    weights = WeightsPublisher(worker.bus, worker.run)

    def publish(blob: WeightBlob) -> None:
        weights.publish(blob)
        worker.weights.note("published", blob)

    responders = [
        Responder(worker.bus, keys.config(worker.run), configuration, worker.counters),
        Responder(worker.bus, keys.next_episode(worker.run), next_episode, worker.counters),
        Responder(worker.bus, keys.episode(worker.run), episode, worker.counters),
    ]
    training = Training(
        config,
        folder,
        ledger,
        attempt=state.attempt,
        publish=publish,
        report=MetricsPublisher(worker.bus, worker.run, "learner", worker.id).put,
        waiting=worker.waiting,
        stop=worker.stop,
    )
    try:
        finished = training.run()
    except (CheckpointError, DivergenceError, RewardError) as error:  # they would come again
        log.error("%s", error)
        folder.set_state("failed", error=str(error))
        return EXIT_UNRECOVERABLE
    folder.set_state("finished" if finished else "stopped")
    if finished:
        ledger.finish()
        worker.stop.wait(_LINGER_S if edges.workers() else 0.0)  # edges ask once more, and are told
    del responders
    return EXIT_FINISHED


def main(argv: list[str] | None = None) -> int:
    """The learner service."""
    parser: argparse.ArgumentParser = argument_parser("learner", __doc__)
    parser.add_argument(
        "--runs-dir", type=Path, default=Path("runs"), help="where run folders are (default runs)"
    )
    options = parser.parse_args(argv)
    return run_service("learner", options, lambda worker: serve(worker, options.runs_dir))
