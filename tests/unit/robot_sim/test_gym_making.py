"""What a configuration asks of an environment leads to no file of the machine where the robot is."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_robot_sim.gym_making import make
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.gym import GymOptions

FILES = st.sampled_from(
    ("/etc/hostname", "./own.xml", "..", "~/own.xml", "own/model.xml", "C:\\own.xml")
)
NAMES = st.text(max_size=8)  # so that all together stay below what the arguments may be long
INSIDE = st.recursive(
    FILES,
    lambda inner: (
        st.lists(inner, min_size=1, max_size=2)
        | st.dictionaries(NAMES, inner, min_size=1, max_size=2)
    ),
    max_leaves=6,
)


def made(task: str, arguments: dict[str, Any]) -> Any:
    return make(task, GymOptions(env_kwargs=json.dumps(arguments)), (), render=True)


@given(INSIDE | st.dictionaries(FILES, st.integers(), min_size=1))
def test_arguments_that_may_name_files_are_refused_before_anything_is_made(value: object) -> None:
    with pytest.raises(
        ConfigError, match=r"gym:Nothing-v0: own = .* may name a file.*gym:MODULE:ID"
    ):
        made("gym:Nothing-v0", {"own": value})


def test_a_file_that_an_environment_would_read_is_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret.xml"
    secret.write_text("<mujoco><unknown/></mujoco>")
    with pytest.raises(ConfigError) as refused:
        made("gym:Ant-v5", {"xml_file": str(secret)})
    assert "may name a file" in str(refused.value)
    assert "unknown" not in str(refused.value)


def test_arguments_of_other_kinds_are_the_environments() -> None:
    env = made("gym:FrozenLake-v1", {"map_name": "8x8", "is_slippery": False})
    try:
        assert env.observation_space.n == 64
    finally:
        env.close()
