"""Training over a run folder whose files are missing, damaged, or of others."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from played import played
from training_runs import INTERRUPTED, RUN, Runs, shas, train

from bpn_learner.checkpoint import CheckpointError, encode_checkpoint
from bpn_learner.episodes import DataError
from bpn_learner.factory import initial_policy
from bpn_shared.runs.digests import seal_line
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig


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
    other = initial_policy(RUN.model_copy(update={"seed": 9}))[0].export(version=3)
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
    other = initial_policy(RUN.model_copy(update={"seed": 9}))[0].export(version=5, attempt=2)
    folder.episode_path(5, 0).write_bytes(played(5, 0, weights_attempt=2))
    folder.weights_path(5).write_bytes(other.encode())
    lines = (folder.path / "metrics.jsonl").read_bytes().splitlines(keepends=True)
    (folder.path / "metrics.jsonl").write_bytes(b"".join(lines[:-1]))
    folder.checkpoint_path.unlink()
    edge = train(folder)
    assert (5, 0) in edge.played
