"""An edge process that starts late, with a real robot beside it; the test speaks the learner's side."""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from uuid import UUID

import numpy as np
import pytest

from bpn_shared import keys
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus
from bpn_shared.bus.weights import WeightsPublisher
from bpn_shared.config import RunConfig
from bpn_shared.messages.control import Assignment, EpisodeReceipt
from bpn_shared.messages.episode import Episode
from bpn_shared.seeds import episode_seed
from bpn_shared.service import Counters

RUN = UUID(int=21)
CONFIG = RunConfig.for_task("reaching", nodes=16, steps=3)


class LearnerSide:
    """Assigns one episode of weights version 7 again and again; keeps what is delivered."""

    def __init__(self, bus: Bus) -> None:
        self.weights = WeightsPublisher(bus, RUN)
        self.attempt = 1
        self.delivered: list[Episode] = []
        self.arrived = threading.Semaphore(0)
        answers = {
            keys.config(RUN): lambda _: CONFIG.model_dump_json().encode(),
            keys.next_episode(RUN): lambda _: self._assignment(),
            keys.episode(RUN): self._take,
        }
        counters = Counters()
        self._responders = [Responder(bus, key, say, counters) for key, say in answers.items()]

    def publish(self, attempt: int, version: int) -> WeightBlob:
        rng = np.random.default_rng([attempt, version])
        blob = replace(
            WeightBlob.random(CONFIG.network, rng), run=RUN, attempt=attempt, version=version
        )
        self.weights.publish(blob)
        return blob

    def _assignment(self) -> bytes:
        seed = episode_seed(CONFIG.seed, 0, 0)
        assignment = Assignment(
            verdict="play", seed=seed, weights_attempt=self.attempt, weights_version=7
        )
        return assignment.encode()

    def _take(self, body: bytes) -> bytes:
        self.delivered.append(Episode.decode(body, CONFIG.task_spec))
        self.arrived.release()
        return EpisodeReceipt(verdict="stored").encode()

    def next_delivery(self) -> Episode:
        assert self.arrived.acquire(timeout=30), "no episode was delivered within 30 s"
        return self.delivered[-1]


@contextmanager
def process(module: str, endpoint: str) -> Iterator[None]:
    place = ["--run", str(RUN), "--slot", "0", "--connect", endpoint]
    running = subprocess.Popen([sys.executable, "-m", module, *place])
    try:
        yield
    finally:
        running.terminate()
        running.wait(10)


@pytest.fixture
def learner(open_bus: Callable[[], Bus]) -> LearnerSide:
    return LearnerSide(open_bus())


def plays(episode: Episode, blob: WeightBlob) -> bool:
    """Whether the blob's network said what the episode records, at every step."""
    expected = [golden.forward(blob, frame)[-1] for frame in episode.frames[:-1]]
    return np.array_equal(np.stack(expected), episode.outputs)


def test_an_edge_started_after_version_7_runs_it_and_follows_a_new_learner(
    endpoint: str, learner: LearnerSide
) -> None:
    for version in range(7):
        learner.publish(1, version)
    seventh = learner.publish(1, 7)
    with process("bpn_robot_sim", endpoint), process("bpn_edge", endpoint):
        episode = learner.next_delivery()
        assert (episode.meta.weights_attempt, episode.meta.weights_version) == (1, 7)
        assert plays(episode, seventh)

        again = learner.publish(2, 7)  # a learner that resumed, with other weights of that version
        learner.publish(1, 9)  # what its predecessor may still have sent
        learner.attempt = 2
        while (episode := learner.next_delivery()).meta.weights_attempt == 1:
            assert plays(episode, seventh)
        assert (episode.meta.weights_attempt, episode.meta.weights_version) == (2, 7)
        assert plays(episode, again)
