"""No run is made twice, and none is taken for another."""

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn.reproduce.manifest import Manifest, config_hash, digest, locked
from bpn_shared.runs.config_file import encode_config
from bpn_shared.spec.config import ConfigError, RunConfig

CONFIGS = st.builds(
    RunConfig.for_task,
    st.sampled_from(["reaching", "tracking", "pan_tilt"]),
    seed=st.integers(0, 2),
    alpha=st.sampled_from([0.5, 0.95]),
    hidden_units=st.sampled_from([16, 100]),
)


@given(CONFIGS, CONFIGS)
def test_configurations_have_equal_hashes_exactly_if_they_are_equal(
    one: RunConfig, other: RunConfig
) -> None:
    assert (config_hash(one) == config_hash(other)) == (one == other)


def test_a_value_given_or_left_at_its_default_is_the_same_run() -> None:
    assert config_hash(RunConfig.bare("tracking")) == config_hash(
        RunConfig.bare("tracking", gamma=0.99, pacing="lockstep")
    )


@pytest.mark.parametrize("task", ["reaching", "tracking", "pan_tilt", "gym:CartPole-v1"])
def test_what_follows_from_the_task_is_no_part_of_a_name(task: str) -> None:
    """Or a field that a later version adds, and fills in from the task, would make every run anew."""
    bare = RunConfig.bare(task, actions=RunConfig.for_task(task).actions)
    assert config_hash(bare) == digest({"task": task, "actions": bare.actions})


def test_a_run_is_found_again_by_its_configuration(tmp_path: Path) -> None:
    one, other = RunConfig.bare("reaching", seed=1), RunConfig.bare("reaching", seed=2)
    first = Manifest(tmp_path).folder(one)
    assert Manifest(tmp_path).folder(one).path == first.path
    assert Manifest(tmp_path).folder(other).path != first.path
    assert Manifest(tmp_path).folder(other).config() == other
    assert len(list(tmp_path.glob("*/config.json"))) == 2


def test_a_run_that_was_removed_is_made_anew(tmp_path: Path) -> None:
    first = Manifest(tmp_path).folder(RunConfig.bare("reaching"))
    shutil.rmtree(first.path)
    assert Manifest(tmp_path).folder(RunConfig.bare("reaching")).path != first.path


def test_a_run_made_before_a_default_changed_is_not_taken_for_one_of_now(tmp_path: Path) -> None:
    first = Manifest(tmp_path).folder(RunConfig.bare("reaching"))
    config = first.path / "config.json"  # as a program with another default had written it
    config.write_bytes(encode_config(RunConfig.bare("reaching", learning_rate=0.5)))
    second = Manifest(tmp_path).folder(RunConfig.bare("reaching"))
    assert second.path != first.path
    assert second.config() == RunConfig.bare("reaching")


def test_a_manifest_of_before_still_knows_its_runs(tmp_path: Path) -> None:
    """Its names were of values that are called otherwise today."""
    first = Manifest(tmp_path).folder(RunConfig.for_task("reaching"))
    (tmp_path / "manifest.json").write_text(
        json.dumps({"0123456789abcdef": str(first.run), "f": "removed"})
    )
    assert Manifest(tmp_path).folder(RunConfig.for_task("reaching")).path == first.path


def test_a_damaged_manifest_is_named_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"abc": ')
    with pytest.raises(ConfigError, match=r"manifest\.json: .*; remove it"):
        Manifest(tmp_path)


def test_two_campaigns_do_not_share_a_folder(tmp_path: Path) -> None:
    refused = pytest.raises(ConfigError, match="another `bpn reproduce` works in")
    with locked(tmp_path), refused, locked(tmp_path):
        pass
    with locked(tmp_path):
        pass  # free again
