"""Training over a run folder: interrupted, damaged, resumed. Episodes come as edges deliver them, with no bus."""

import contextlib
import json
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

import pytest
import torch
from played import CONFIG, played
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import Tensor

from bpn_learner import training as training_module
from bpn_learner.checkpoint import CheckpointError, encode_checkpoint
from bpn_learner.episodes import DataError
from bpn_learner.export import export
from bpn_learner.group import GroupLostError, SingleProcess
from bpn_learner.handout import MAX_BYTES, receive_state
from bpn_learner.initial import initial_policy
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.reward import episode_rewards
from bpn_learner.storage import StorageError
from bpn_learner.training import GIVE_UP_AFTER, Training
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import UpdateConfig, policy_update
from bpn_shared.bnn.weights import Weights
from bpn_shared.counters import Counters
from bpn_shared.messages.control import NextEpisode
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.digests import seal_line
from bpn_shared.runs.folder import OwnershipLostError, RunFolder
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import shuffle_generator
from bpn_shared.waiting import Waiting

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
                if told.verdict != "play":
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
        ledger = EpisodeLedger(config, owner, {"edge-0"}, Waiting(), Counters())
        training = Training(
            config, owner, ledger, publish=edge.publish, report=report, rendezvous=rendezvous,
            waiting=Waiting(), stop=stop,
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


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    whole = RunFolder.create(tmp_path_factory.mktemp("whole"), UUID(int=1), RUN)
    train(whole)
    interrupted = RunFolder.create(tmp_path_factory.mktemp("cut"), UUID(int=1), RUN)
    train(interrupted, stop_after=INTERRUPTED)
    return Runs(whole, interrupted)


@pytest.fixture
def folder(runs: Runs, tmp_path: Path) -> RunFolder:
    """A copy of the interrupted run."""
    copy = RunFolder(tmp_path / runs.interrupted.path.name)
    shutil.copytree(runs.interrupted.path, copy.path)
    return copy


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
        assert found == export(network).content_sha256(), f"version {iteration + 1}"
    assert len(set(shas(runs.whole))) == RUN.iterations


def test_a_resumed_run_plays_only_what_is_missing_and_ends_the_same(
    runs: Runs, folder: RunFolder
) -> None:
    edge = train(folder)
    assert shas(folder) == shas(runs.whole)
    assert folder.rewards() == runs.whole.rewards()
    assert edge.played == [(i, e) for i in (4, 5) for e in range(RUN.episodes)]
    assert folder.state().attempt == 2


def delete(*which: tuple[int, int]) -> Callable[[RunFolder], None]:
    return lambda folder: [folder.episode_path(*w).unlink() for w in which] and None


def flip(iteration: int, index: int) -> Callable[[RunFolder], None]:
    def change(folder: RunFolder) -> None:
        path = folder.episode_path(iteration, index)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)

    return change


def both(*changes: Callable[[RunFolder], None]) -> Callable[[RunFolder], None]:
    return lambda folder: [change(folder) for change in changes] and None


HOLES = [
    ([(3, 0)], delete((3, 0))),
    ([(2, 3)], delete((2, 3))),
    ([(2, 1), (3, 2)], both(delete((2, 1)), flip(3, 2))),
    ([(3, e) for e in range(4)], delete(*((3, e) for e in range(4)))),
    ([], delete((0, 0), (1, 3))),  # no update needs them any more
]


@pytest.mark.parametrize(("missing", "change"), HOLES)
def test_missing_data_of_iterations_that_are_done_are_played_again_with_their_weights(
    runs: Runs,
    folder: RunFolder,
    missing: list[tuple[int, int]],
    change: Callable[[RunFolder], None],
) -> None:
    change(folder)
    edge = train(folder)
    assert edge.played[: len(missing)] == missing
    assert len(edge.played) == len(missing) + 2 * RUN.episodes
    assert shas(folder) == shas(runs.whole)
    assert folder.rewards() == runs.whole.rewards()
    ranks = [published[:2] for published in edge.published]
    assert ranks == sorted(ranks)  # as edges take them
    for _, version, sha256 in edge.published:
        assert sha256 == runs.whole.weights(version).content_sha256()


def test_the_first_iterations_weights_are_known_from_the_seed(tmp_path: Path, runs: Runs) -> None:
    folder = RunFolder.create(tmp_path, UUID(int=1), RUN)
    train(folder, stop_after=1)
    folder.episode_path(0, 2).unlink()
    folder.weights_path(0).unlink()
    assert (0, 2) in train(folder).played
    assert shas(folder) == shas(runs.whole)


@pytest.mark.parametrize("damaged", [
    lambda path: path.unlink(),
    lambda path: path.write_bytes(path.read_bytes()[:-1]),
    lambda path: shutil.copy(path.with_name("000001.bpnw"), path),
])  # fmt: skip
def test_data_that_cannot_be_played_again_are_a_named_error(
    folder: RunFolder, damaged: Callable[[Path], object]
) -> None:
    folder.episode_path(3, 0).unlink()
    damaged(folder.weights_path(3))
    with pytest.raises(
        DataError, match=r"of iteration 3 are missing .*000003\.bpnw.*remove checkpoint"
    ):
        train(folder)


def test_weights_of_another_content_are_not_played_again(folder: RunFolder) -> None:
    folder.episode_path(3, 0).unlink()
    other = export(initial_policy(RUN.model_copy(update={"seed": 9}))[0], version=3)
    folder.weights_path(3).write_bytes(other.encode())
    with pytest.raises(DataError, match="is not version 3 of this run"):
        train(folder)


def test_without_a_checkpoint_it_begins_again_with_the_episodes_there_are(
    runs: Runs, folder: RunFolder
) -> None:
    folder.checkpoint_path.unlink()
    edge = train(folder)
    assert edge.played == [(i, e) for i in (4, 5) for e in range(RUN.episodes)]
    assert shas(folder) == shas(runs.whole)


def test_a_checkpoint_of_another_run_is_not_gone_on_from(folder: RunFolder) -> None:
    network, optimizer = initial_policy(RUN.model_copy(update={"seed": 4}))
    folder.checkpoint_path.write_bytes(encode_checkpoint(network, optimizer, INTERRUPTED))
    with pytest.raises(CheckpointError, match="other weights than version 4"):
        train(folder)
    (folder.path / "metrics.jsonl").unlink()  # then the weights' file tells
    with pytest.raises(CheckpointError, match="other weights than version 4"):
        train(folder)


def test_a_checkpoint_beyond_the_runs_end_is_refused(folder: RunFolder) -> None:
    folder.checkpoint_path.write_bytes(encode_checkpoint(*initial_policy(RUN), 7))
    with pytest.raises(CheckpointError, match="tells of 7 updates, the run has 6"):
        train(folder)


def rewrite_rewards(folder: RunFolder, iteration: int, change: Callable[[Any], Any]) -> None:
    path = folder.path / "rewards.jsonl"
    records = [json.loads(line) for line in path.read_bytes().splitlines()]
    for record in records:
        del record["sha256"]
        if record["iteration"] == iteration:
            record["rewards_px"] = change(record["rewards_px"])
    path.write_bytes(b"".join(seal_line(record) + b"\n" for record in records))


def test_rewards_that_are_others_than_they_were_are_a_named_error(folder: RunFolder) -> None:
    rewrite_rewards(folder, 3, lambda px: [*px[:2], [value - 1 for value in px[2]], px[3]])
    with pytest.raises(DataError, match=r"episode \(3, 2\) has other rewards than rewards\.jsonl"):
        train(folder)


def test_lost_rewards_are_computed_again(runs: Runs, folder: RunFolder) -> None:
    rewrite_rewards(folder, 3, lambda px: px[:-1])
    with pytest.raises(DataError):
        train(folder)
    (folder.path / "rewards.jsonl").unlink()
    folder = RunFolder(folder.path)
    train(folder)
    assert {i: folder.rewards()[i] for i in range(2, 6)} == {
        i: runs.whole.rewards()[i] for i in range(2, 6)
    }


def test_what_was_played_again_in_realtime_may_have_other_rewards(
    tmp_path: Path,
) -> None:
    realtime = RunConfig.model_validate(RUN.model_dump() | {"pacing": "realtime"})
    folder = RunFolder.create(tmp_path, UUID(int=1), realtime)
    train(folder, stop_after=3)
    rewrite_rewards(folder, 2, lambda px: [[value - 1 for value in px[0]], *px[1:]])
    before = folder.rewards()[2]
    folder.episode_path(2, 0).unlink()
    train(folder)
    assert folder.rewards()[2][0] != before[0]
    assert folder.rewards()[2][1:] == before[1:]


def test_an_update_that_is_done_again_from_the_same_data_is_the_same(
    runs: Runs, folder: RunFolder
) -> None:
    """The checkpoint of before: as after a crash between metrics and checkpoint."""
    shutil.copy(folder.checkpoint_path, folder.path / "kept")
    train(folder, stop_after=5)
    shutil.move(folder.path / "kept", folder.checkpoint_path)
    edge = train(folder)
    assert edge.played == [(5, e) for e in range(RUN.episodes)]
    assert shas(folder) == shas(runs.whole)


def test_what_other_weights_have_played_is_not_learned_from(folder: RunFolder) -> None:
    """Version 4 was another in the attempt before: its episodes are no data of this one's."""
    train(folder, stop_after=5)
    other = export(initial_policy(RUN.model_copy(update={"seed": 9}))[0], version=5, attempt=2)
    folder.episode_path(5, 0).write_bytes(played(5, 0, weights_attempt=2))
    folder.weights_path(5).write_bytes(other.encode())
    lines = (folder.path / "metrics.jsonl").read_bytes().splitlines(keepends=True)
    (folder.path / "metrics.jsonl").write_bytes(b"".join(lines[:-1]))
    folder.checkpoint_path.unlink()
    edge = train(folder)
    assert (5, 0) in edge.played


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
        waiting = Waiting()
        ledger = EpisodeLedger(RUN, owner, {"edge-0"}, Waiting(), Counters())
        training = Training(
            RUN, owner, ledger, publish=edge.publish, report=lambda *_: None, rendezvous=None,
            waiting=waiting, stop=stop_after,
        )  # fmt: skip
        with edge.at(ledger):
            assert not training.run()
    assert "room on the disk: cannot write metrics" in (waiting.snapshot()[0] or "")


def losing(monkeypatch: pytest.MonkeyPatch, times: int) -> list[int]:
    """The first updates lose a learner when they are nearly done."""
    tried: list[int] = []

    def update(*arguments: Any, **more: Any) -> Any:
        report = policy_update(*arguments, **more)
        tried.append(1)
        if len(tried) <= times:
            raise GroupLostError("learner-2 is gone")
        return report

    monkeypatch.setattr(training_module, "policy_update", update)
    return tried


def test_an_update_that_lost_a_learner_begins_again_from_the_checkpoint(
    runs: Runs, folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = losing(monkeypatch, 2)
    train(folder)
    assert shas(folder) == shas(runs.whole)
    assert len(tried) == 4  # of two iterations


def test_updates_that_lose_a_learner_each_time_have_an_end(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = losing(monkeypatch, 1000)
    with pytest.raises(GroupLostError, match="learner-2"):
        train(folder)
    assert len(tried) == GIVE_UP_AFTER == 8
    assert len(folder.metrics()) == INTERRUPTED


class Handed(SingleProcess):
    """A group of one that keeps what is handed out, and hands it on to who takes it."""

    exchange_s = 1.5

    def __init__(self) -> None:
        self.told: list[Tensor] = []

    def broadcast(self, values: Tensor) -> None:
        self.told.append(values.clone())

    @contextlib.contextmanager
    def gathered(self) -> Iterator["Handed"]:
        yield self


class Taking(Handed):
    def broadcast(self, values: Tensor) -> None:
        values.copy_(self.told.pop(0))


def test_who_shares_an_update_is_told_all_of_it(runs: Runs, folder: RunFolder) -> None:
    group = Handed()
    train(folder, stop_after=5, rendezvous=group)
    assert shas(folder) == shas(runs.whole)[:5]
    assert folder.metrics()[-1]["exchange_s"] == 1.5
    assert runs.whole.metrics()[-1]["exchange_s"] == 0.0
    taking = Taking()
    taking.told = group.told[:2]
    network, optimizer = initial_policy(RUN)
    regression, iteration = receive_state(taking, network, optimizer)  # type: ignore[arg-type]
    assert iteration == INTERRUPTED
    assert len(regression.y) == 2 * RUN.episodes * RUN.steps
    before = runs.whole.weights(INTERRUPTED).content_sha256()
    assert export(network).content_sha256() == before


@pytest.mark.parametrize("size", [0, -1, MAX_BYTES + 1])
def test_what_cannot_be_an_update_is_not_waited_for(size: int) -> None:
    taking = Taking()
    taking.told = [torch.tensor([size])]
    with pytest.raises(GroupLostError, match=f"tells {size} bytes, at most"):
        receive_state(taking, *initial_policy(RUN))  # type: ignore[arg-type]


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
