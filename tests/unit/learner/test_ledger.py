import re
import threading
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_learner.ledger import EpisodeLedger, load_episodes
from bpn_shared.config import RunConfig
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import NextEpisode
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.runs.folder import RunFolder
from bpn_shared.seeds import episode_seed

CONFIG = RunConfig.for_task("reaching", seed=3, episodes=4, steps=2)
TASK = CONFIG.task_spec


def played(
    iteration: int,
    episode: int,
    steps: int = 2,
    outputs: type = np.int32,
    rewards: float = np.nan,
    **changes: Any,
) -> bytes:
    meta = EpisodeMeta(
        iteration=iteration, episode=episode, seed=episode_seed(CONFIG.seed, iteration, episode),
        slot=0, worker="edge-0", weights_attempt=1, weights_version=iteration, terminated=False,
        deadline_misses=0, duration_ns=1,
    ).model_copy(update=changes)  # fmt: skip
    return Episode(
        meta=meta,
        frames=np.zeros((steps + 1, *TASK.frame_shape), np.uint8),
        actions=np.zeros(steps, np.uint8),
        rewards=np.full(steps, rewards),
        outputs=np.zeros((steps, TASK.actions), outputs),
        inference_ns=np.zeros(steps, np.uint32),
        camera_to_action_ns=np.zeros(steps, np.uint32),
    ).encode()


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder.create(tmp_path, UUID(int=1), CONFIG)


def ask(ledger: EpisodeLedger, slot: int, worker: str | None = None) -> tuple[str, int]:
    assignment = ledger.next(NextEpisode(slot=slot, worker=worker or f"edge-{slot}"))
    return assignment.verdict, assignment.episode


def test_slots_get_different_episodes_with_their_seeds(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive={"edge-0", "edge-1"})
    assert ask(ledger, 0)[0] == "wait"  # nothing is collected yet
    ledger.begin(5, attempt=1)
    assert [ask(ledger, 0), ask(ledger, 1)] == [("play", 0), ("play", 1)]
    assignment = ledger.next(NextEpisode(slot=0, worker="edge-0"))
    assert assignment.seed == episode_seed(CONFIG.seed, 5, 0)
    assert assignment.weights_version == 5


def test_the_lag_of_weights_is_told_of_hand_outs_alone(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive={"edge-0", "edge-1"})

    def ask_with(slot: int, version: int | None) -> str:
        asked = NextEpisode(slot=slot, worker=f"edge-{slot}", weights_version=version)
        return ledger.next(asked).verdict

    assert ask_with(0, 4) == "wait"  # there is no newer version yet
    ledger.begin(5, attempt=1)
    assert ledger.weights_version_lag() == 0.0
    assert [ask_with(0, 3), ask_with(0, 5), ask_with(1, 4), ask_with(1, None)] == ["play"] * 4
    assert ledger.weights_version_lag() == pytest.approx((2 + 0 + 1) / 3)
    ledger.begin(6, attempt=1)
    assert ledger.weights_version_lag() == 0.0


def test_a_slot_that_asks_again_gets_what_it_had(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive={"edge-0", "edge-1", "edge-0b"})
    ledger.begin(0, attempt=1)
    assert ask(ledger, 1) == ("play", 0)
    assert ask(ledger, 0) == ("play", 1)
    assert ask(ledger, 0, "edge-0b") == ("play", 1)  # the slot's edge was restarted


def test_a_dead_edges_episode_is_handed_out_again(folder: RunFolder) -> None:
    alive = {"edge-0", "edge-1"}
    ledger = EpisodeLedger(CONFIG.model_copy(update={"episodes": 2}), folder, alive)
    ledger.begin(0, attempt=1)
    assert [ask(ledger, 0), ask(ledger, 1)] == [("play", 0), ("play", 1)]
    assert ask(ledger, 2, "edge-2")[0] == "wait"
    alive.remove("edge-1")
    assert ask(ledger, 2, "edge-2") == ("play", 1)


def test_an_episode_is_on_disk_when_it_is_acknowledged_and_counts_once(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.begin(0, attempt=1)
    assert ledger.receive(played(0, 2)).verdict == "stored"
    assert folder.episode_path(0, 2).read_bytes() == played(0, 2)
    assert ledger.receive(played(0, 2)).verdict == "duplicate"
    assert ledger.redelivered == 1
    ledger.begin(1, attempt=1)
    assert ledger.receive(played(0, 2)).verdict == "duplicate"


@settings(max_examples=30)
@given(order=st.permutations(range(4)), repeats=st.lists(st.integers(0, 3), max_size=4))
def test_any_order_of_deliveries_gives_the_same_data(
    tmp_path_factory: pytest.TempPathFactory, order: list[int], repeats: list[int]
) -> None:
    folder = RunFolder.create(tmp_path_factory.mktemp("runs"), UUID(int=1), CONFIG)
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.begin(0, attempt=1)
    for episode in [*repeats, *order]:
        ledger.receive(played(0, episode))
    collected = ledger.wait_complete(threading.Event(), lambda _: None)
    assert collected is not None
    assert [episode.meta.episode for episode in collected] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (played(1, 0), "iteration 1 has not begun"),
        (played(0, 0, weights_version=3), "played with weights version 3"),
        (played(0, 4), r"episodes 0\.\.3"),
        (played(0, 0, seed=1), "seed 1 is another run's"),
        (played(0, 0, steps=1), "1 steps, an episode of this run has 2"),
        (played(0, 0, steps=3), "3 steps"),
        (played(0, 0, outputs=np.float32), "outputs are float32, bpn has int32"),
    ],
)
def test_an_episode_that_is_no_data_is_refused_with_its_reason(
    folder: RunFolder, data: bytes, reason: str
) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.begin(0, attempt=1)
    receipt = ledger.receive(data)
    assert receipt.verdict == "refused"
    assert not list((folder.path / "episodes").iterdir())
    assert re.search(reason, receipt.reason)


def test_a_terminated_episode_may_be_shorter(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.begin(0, attempt=1)
    assert ledger.receive(played(0, 0, steps=1, terminated=True)).verdict == "stored"


def test_rewards_told_by_a_robot_have_to_be_there_and_its_episodes_may_end_early(
    tmp_path: Path,
) -> None:
    config = RunConfig.for_task(
        "gym:A-v0", actions=14, frames_stacked=1, seed=3, episodes=4, steps=2
    )
    ledger = EpisodeLedger(config, RunFolder.create(tmp_path, UUID(int=1), config), alive=set())
    ledger.begin(0, attempt=1)
    assert ledger.receive(played(0, 0)).reason.startswith("not every step has a reward")
    assert ledger.receive(played(0, 0, rewards=1.0)).verdict == "stored"
    assert ledger.receive(played(0, 1, steps=1, rewards=1.0)).verdict == "stored"
    assert ledger.receive(played(0, 2, steps=3, rewards=1.0)).verdict == "refused"


def test_damaged_bytes_are_refused(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.begin(0, attempt=1)
    with pytest.raises(MessageError):
        ledger.receive(played(0, 0)[:-7])


def test_a_restarted_learner_takes_up_what_is_on_disk(folder: RunFolder) -> None:
    first = EpisodeLedger(CONFIG, folder, alive={"edge-0"})
    first.begin(0, attempt=1)
    for episode in (0, 1, 3):
        first.receive(played(0, episode))
    folder.episode_path(0, 1).write_bytes(b"damaged by a full disk")
    second = EpisodeLedger(CONFIG, folder, alive={"edge-0"})
    second.begin(0, attempt=2)
    assert ask(second, 0) == ("play", 1)
    assert second.receive(played(0, 0)).verdict == "duplicate"
    assert second.receive(played(0, 1)).verdict == "stored"
    assert sorted(load_episodes(folder, CONFIG, 0)) == [0, 1, 3]
    assert folder.episode_path(0, 1).with_suffix(".damaged").exists()


def test_a_stopped_learner_does_not_wait(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.begin(0, attempt=1)
    stop = threading.Event()
    stop.set()
    assert ledger.wait_complete(stop, lambda _: None) is None


def test_after_the_last_iteration_edges_are_told_so(folder: RunFolder) -> None:
    ledger = EpisodeLedger(CONFIG, folder, alive=set())
    ledger.finish()
    assert ask(ledger, 0)[0] == "finished"
