"""Training over a run folder: what it makes, interrupted and resumed."""

import threading
from pathlib import Path
from uuid import UUID

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training_runs import INTERRUPTED, RUN, Edge, Runs, shas, train

from bpn_learner.factory import initial_policy
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.reward import episode_rewards
from bpn_learner.training import Training
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import UpdateConfig, policy_update
from bpn_shared.counters import Counters
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import OwnershipLostError, RunFolder
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import shuffle_generator
from bpn_shared.waiting import WaitStatus


def test_every_version_is_what_its_configuration_and_its_newest_data_sets_make(runs: Runs) -> None:
    """Told once more, in plain words: Algorithm 1 over the episodes in the run folder."""
    network, optimizer = initial_policy(RUN)
    for iteration in range(RUN.iterations):
        newest = range(max(0, iteration - 1), iteration + 1)  # U = 2
        D = []
        for data_set in newest:
            for index in range(RUN.episodes):
                data = runs.whole.episode_path(data_set, index).read_bytes()
                episode = Episode.decode(data, RUN.task_spec)
                rewards = episode_rewards(RUN.task_spec, episode) * 0.05
                D.append(EpisodeData(episode.frames, episode.actions, rewards, index == 1))
        settings = UpdateConfig(
            alpha=0.7, beta=2.0, gamma=0.8, epochs=3, batch_size=2, target="cvi", bootstrap_terminals=False,
            relative_targets=True, learning_rate_share=1 - 0.6 * iteration / 5,
            lr_update_final_factor=0.3, backend="native",
        )  # fmt: skip
        policy_update(
            network, optimizer, Transitions.from_episodes(D, frames_stacked=1), settings,
            shuffle_generator(3, iteration),
        )  # fmt: skip
        found = runs.whole.weights(iteration + 1).content_sha256()
        assert found == network.export().content_sha256(), f"version {iteration + 1}"
    assert len(set(shas(runs.whole))) == RUN.iterations


def test_a_resumed_run_plays_only_what_is_missing_and_ends_the_same(
    runs: Runs, folder: RunFolder
) -> None:
    edge = train(folder)
    assert shas(folder) == shas(runs.whole)
    assert folder.rewards() == runs.whole.rewards()
    assert edge.played == [(i, e) for i in (4, 5) for e in range(RUN.episodes)]
    assert folder.state().attempt == 2


def test_the_wait_for_room_ends_with_a_stop(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    edge = Edge()
    stop_after = threading.Event()

    def full(*_: object, **__: object) -> None:
        stop_after.set()
        raise OSError(28, "No space left on device")

    with folder.owned("learner-1") as owner:
        owner.begin_attempt()
        monkeypatch.setattr(owner, "append_metrics", full)
        waiting = WaitStatus()
        ledger = EpisodeLedger(RUN, owner, {"edge-0"}, WaitStatus(), Counters())
        training = Training(
            RUN, owner, ledger, publish=edge.publish, report=lambda *_: None, rendezvous=None,
            waiting=waiting, stop=stop_after,
        )  # fmt: skip
        with edge.at(ledger):
            assert not training.run()
    assert "room on the disk: cannot write metrics" in (waiting.snapshot()[0] or "")


def test_tensorboard_gets_the_metrics_if_it_is_asked_for(tmp_path: Path) -> None:
    for asked in (False, True):
        config = RunConfig.model_validate(RUN.model_dump() | {"tensorboard": asked})
        folder = RunFolder.create(tmp_path / str(asked), UUID(int=1), config)
        train(folder, stop_after=1)
        assert (folder.path / "tensorboard").exists() == asked
    told = EventAccumulator(str(folder.path / "tensorboard")).Reload().Scalars("return_px")
    assert [point.value for point in told] == pytest.approx([folder.metrics()[0]["return_px"]])


def test_the_record_of_an_iteration_is_of_its_episodes(runs: Runs) -> None:
    for iteration, record in enumerate(runs.whole.metrics()):
        px = runs.whole.rewards()[iteration]
        assert record["iteration"] == iteration
        assert record["returns_px"] == pytest.approx([sum(one) for one in px], abs=0.01)
        assert record["return_px"] == pytest.approx(sum(map(sum, px)) / len(px), abs=0.01)
        assert record["episodes"] == RUN.episodes
        assert record["transitions"] == RUN.episodes * RUN.steps
        assert (record["length"], record["terminated"]) == (RUN.steps, 1)
        assert (record["attempt"], record["weights_version"]) == (1, iteration + 1)
        assert record["weights_version_lag"] == 0.0
        D = min(iteration + 1, RUN.replay_iterations) * record["transitions"]
        assert record["updates"] == RUN.epochs * -(-D // RUN.batch_size)
        assert 0 < record["update_s"] <= record["iteration_s"]
        assert 0 <= record["collect_s"] <= record["iteration_s"]


def test_a_learner_that_was_replaced_publishes_nothing_more(folder: RunFolder) -> None:
    edge = Edge()

    def take_over(iteration: int, index: int) -> None:
        if (iteration, index) == (4, 3):
            (folder.path / ".lock").unlink()
            with folder.owned("learner-2") as other:
                other.begin_attempt()

    edge.on_play = take_over
    with pytest.raises(OwnershipLostError):
        train(folder, edge=edge)
    assert edge.published[-1][:2] == (2, 4)
    assert len(folder.metrics()) == INTERRUPTED
