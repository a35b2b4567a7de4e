"""An edge process that starts late, with a real robot beside it; the test speaks the learner's side."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from learner_side import RUN, LearnerSide

from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bus.session import Bus
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching", hidden_units=16, steps=3)


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
    return LearnerSide(open_bus(), CONFIG)


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
