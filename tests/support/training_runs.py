"""A small run that a learner trains, with episodes as edges deliver them, with no bus."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from played import CONFIG, played

from bpn_learner.ledger import EpisodeLedger
from bpn_learner.storage import StorageError
from bpn_learner.training import Training
from bpn_shared.bnn.weights import Weights
from bpn_shared.counters import Counters
from bpn_shared.messages.control import NextEpisode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig
from bpn_shared.waiting import WaitStatus

SETTINGS: dict[str, Any] = {
    "iterations": 6, "replay_iterations": 2, "epochs": 3, "alpha": 0.7, "beta": 2.0, "gamma": 0.8,
    "bootstrap_terminals": False, "relative_targets": True, "learning_rate": 0.05,
    "lr_update_final_factor": 0.3, "lr_run_final_factor": 0.4, "reward_scale": 0.05,
}  # fmt: skip
RUN = RunConfig.model_validate(CONFIG.model_dump() | SETTINGS)
INTERRUPTED = 4
"""Iterations that are done when it is interrupted."""


class Edge:
    """Plays what it is told to; its episodes are a function of (iteration, episode), as in lockstep."""

    def __init__(self) -> None:
        self.played: list[tuple[int, int]] = []
        self.published: list[tuple[int, int, str]] = []
        self.on_play: Callable[[int, int], None] = lambda _i, _e: None

    def publish(self, weights: Weights) -> None:
        self.published.append((weights.attempt, weights.version, weights.content_sha256()))

    @contextlib.contextmanager
    def at(self, ledger: EpisodeLedger) -> Iterator[None]:
        stop = threading.Event()

        def play() -> None:
            while not stop.is_set():
                told = ledger.next(NextEpisode(slot=0, worker="edge-0"))
                if told.status != "play":
                    stop.wait(0.001)
                    continue
                # What the assignment says is the newest that was published.
                assert self.published[-1][:2] == (told.weights_attempt, told.weights_version)
                self.on_play(told.iteration, told.episode)
                self.played.append((told.iteration, told.episode))
                data = played(
                    told.iteration, told.episode, weights_attempt=told.weights_attempt,
                    terminated=told.episode == 1,
                )  # fmt: skip
                with contextlib.suppress(StorageError):  # which the bus tells as a refusal
                    ledger.receive(data)

        thread = threading.Thread(target=play)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(10)


def train(
    folder: RunFolder,
    stop_after: int | None = None,
    edge: Edge | None = None,
    rendezvous: Any = None,
) -> Edge:
    """One attempt at a run."""
    edge, stop = edge or Edge(), threading.Event()

    def report(iteration: int, values: Any) -> None:
        if "loss" in values and iteration + 1 == stop_after:
            stop.set()

    with folder.owned("learner-1") as owner:
        owner.begin_attempt()
        config = folder.config()
        ledger = EpisodeLedger(config, owner, {"edge-0"}, WaitStatus(), Counters())
        training = Training(
            config, owner, ledger, publish=edge.publish, report=report, rendezvous=rendezvous,
            waiting=WaitStatus(), stop=stop,
        )  # fmt: skip
        with edge.at(ledger):
            assert training.run() == (stop_after is None)
    return edge


def shas(folder: RunFolder) -> list[str]:
    return [record["weights_sha256"] for record in folder.metrics()]


class Runs(NamedTuple):
    """The same run, undisturbed and interrupted."""

    whole: RunFolder
    interrupted: RunFolder
