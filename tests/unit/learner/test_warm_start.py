"""A run that begins with another one's weights."""

import shutil
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from played import CONFIG

from bpn_learner.checkpoint import CheckpointError, encode_checkpoint
from bpn_learner.factory import initial_policy
from bpn_learner.history import History
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig

SOURCE = UUID(int=1)


def make(runs_dir: Path, run: int, **changes: Any) -> RunFolder:
    config = RunConfig.for_task("reaching", **{"seed": 9, "steps": 2, "hidden_units": 1} | changes)
    return RunFolder.create(runs_dir, UUID(int=run), config)


@pytest.fixture(params=["bpn", "dqn"])
def source(request: pytest.FixtureRequest, tmp_path: Path) -> RunFolder:
    """A run after three updates, as far as its folder is concerned."""
    config = RunConfig.for_task(
        "reaching", algorithm=request.param, steps=2, hidden_units=1, seed=3
    )
    folder = RunFolder.create(tmp_path, SOURCE, config)
    network, optimizer = initial_policy(config)
    network.offset.fill_(2.5)
    with folder.owned("learner-1") as owner:
        owner.begin_attempt()
        for version in (2, 3):
            owner.write_weights(network.export(run=SOURCE, attempt=1, version=version))
        owner.write_checkpoint(encode_checkpoint(network, optimizer, 3))
    return folder


def sha256(folder: RunFolder) -> str:
    return folder.weights(3).content_sha256()


@pytest.mark.parametrize("version", ["", ":3"])
def test_before_the_first_update_the_weights_are_the_others_whatever_becomes_of_it(
    source: RunFolder, version: str
) -> None:
    algorithm = source.config().algorithm
    folder = make(source.path.parent, 2, init_from=f"{SOURCE}{version}", algorithm=algorithm)
    shutil.rmtree(source.path)
    config = folder.config()
    told = config.init_from.split(":")
    network, optimizer, done = History(config, folder).load_policy()
    assert told == [str(SOURCE), "3", network.export().content_sha256()]
    assert initial_policy(config)[0].export().content_sha256() != told[2]
    assert (float(network.offset), done) == (2.5, 0)
    assert not optimizer.state_dict()["state"], "Adam begins anew"
    assert History(config, folder).weights(0, 1).content_sha256() == told[2]


def test_the_name_that_is_kept_is_taken_again_and_checked(source: RunFolder) -> None:
    algorithm = source.config().algorithm
    first = make(source.path.parent, 2, init_from=str(SOURCE), algorithm=algorithm).config()
    again = make(source.path.parent, 3, init_from=first.init_from, algorithm=algorithm).config()
    assert again.init_from == first.init_from == f"{SOURCE}:3:{sha256(source)}"


@pytest.mark.parametrize(("changes", "what"), [
    ({"hidden_units": 2}, "is 1 channels x 1 hidden units x 14 actions, this run's is 1 channels x 2 hidden"),
    ({"algorithm": "other"}, "has a (binary|float) network, '(bpn|dqn)' a (float|binary) one"),
    ({"init_from": f"{SOURCE}:2"}, "only version 3 of that run can be gone on from"),
    ({"init_from": f"{SOURCE}:3:{'0' * 64}"}, "version 3 of that run has the SHA-256 [0-9a-f]{64}"),
    ({"init_from": "00ff"}, "no run in .* matches '00ff'"),
    ({"init_from": "../x"}, "init_from"),
])  # fmt: skip
def test_what_cannot_be_begun_with_is_one_line_and_leaves_nothing(
    source: RunFolder, changes: dict[str, Any], what: str
) -> None:
    algorithm = source.config().algorithm
    if changes.get("algorithm"):
        changes = {"algorithm": {"bpn": "dqn", "dqn": "bpn"}[algorithm]}
    with pytest.raises(ConfigError, match=what) as error:
        make(source.path.parent, 2, **{"init_from": str(SOURCE), "algorithm": algorithm} | changes)
    assert "\n" not in str(error.value)
    assert [path.name for path in source.path.parent.iterdir()] == [str(SOURCE)]


def test_a_run_without_a_checkpoint_is_none_to_begin_with(tmp_path: Path) -> None:
    RunFolder.create(tmp_path, SOURCE, CONFIG)
    with pytest.raises(ConfigError, match="has no checkpoint yet"):
        make(tmp_path, 2, init_from=str(SOURCE))


@pytest.mark.parametrize("flipped", [-3, 40])
def test_a_damaged_copy_is_said(source: RunFolder, flipped: int) -> None:
    algorithm = source.config().algorithm
    folder = make(source.path.parent, 2, init_from=str(SOURCE), algorithm=algorithm)
    path = folder.path / "initial.safetensors"
    data = bytearray(path.read_bytes())
    data[flipped] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckpointError, match=r"initial.safetensors, what the run begins with"):
        History(folder.config(), folder).load_policy()


@pytest.mark.parametrize("damage", [lambda data: data[:5], lambda data: b"\xff" * 8 + data[8:]])
def test_a_damaged_checkpoint_of_the_other_run_is_said(source: RunFolder, damage: Any) -> None:
    source.checkpoint_path.write_bytes(damage(source.checkpoint_path.read_bytes()))
    algorithm = source.config().algorithm
    with pytest.raises(
        ConfigError, match=r"cannot be begun with: checkpoint.safetensors is damaged"
    ):
        make(source.path.parent, 2, init_from=str(SOURCE), algorithm=algorithm)
