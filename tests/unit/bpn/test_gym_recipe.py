"""The comparison's own parts: the game of Catch, and what somebody else's algorithm is shown."""

import json
from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

from bench import gym_recipe
from bench.gym_catch import BALL, CELL_PX, COLUMNS, PADDLE, Catch, Picture
from bpn_shared.spec.config import RunConfig


def column(picture: Picture, level: int) -> int:
    found: int = np.flatnonzero((picture[:, :, 0] == level).any(axis=0))[0]
    return int(found) // CELL_PX


def play(seed: int, *, away: bool) -> float:
    env = Catch()
    picture, _ = env.reset(seed=seed)
    while True:
        ball, paddle = column(picture, BALL), column(picture, PADDLE)
        move = np.sign(ball - paddle)
        if away:
            move = 1 if ball < COLUMNS // 2 else -1
        picture, reward, ended, _, info = env.step(np.int64(move + 1))
        if ended:
            assert info["is_success"] == (reward > 0)
            return reward
        assert reward == 0


@given(st.integers(0, 2**32))
@settings(max_examples=30)
def test_whoever_follows_the_ball_catches_it_and_whoever_flees_does_not(seed: int) -> None:
    assert play(seed, away=False) == 1
    assert play(seed, away=True) == -1


def test_it_is_an_environment_as_gymnasium_wants_them() -> None:
    check_env(Catch(), skip_render_check=True)


@pytest.mark.parametrize("name", gym_recipe.TASKS)
def test_every_task_has_the_preset_but_for_its_frames(name: str) -> None:
    config = gym_recipe.config_of(gym_recipe.TASKS[name], 3)
    preset = RunConfig.for_task("gym:Untuned-v0", actions=config.actions, seed=3)
    frames = {"frame_channels", "frame_skip", "difference", "crop"}
    same = {"task", "task_spec", *frames}
    assert config.model_dump(exclude=same) == preset.model_dump(exclude=same)
    assert set(gym_recipe.TASKS[name].options) <= frames


def test_somebody_elses_algorithm_sees_what_the_policy_sees(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("BPN_GYM_MODULES", "bench.gym_catch")
    config = gym_recipe.config_of(gym_recipe.TASKS["catch"], 0, steps=5)
    env, own = gym_recipe.Seen(config), Catch()
    seen, _ = env.reset(seed=4)
    first, _ = own.reset(seed=4)
    assert seen.shape == config.network.observation_shape == (2, 84, 84)
    assert np.array_equal(seen[0], seen[1])
    assert (BALL in seen) == (BALL in first)
    for step in range(5):
        before = seen
        seen, reward, terminated, truncated, _ = env.step(np.int64(1))
        assert np.array_equal(seen[0], before[1])
        assert (reward, terminated, truncated) == (0, False, step == 4)
    env.close()


def test_the_table_has_the_tasks_of_which_all_agents_were_run(tmp_path: Path) -> None:
    for agent, total in (("random", 0.0), ("bpn", 3.0), ("dqn", 4.0)):
        for seed in range(2):
            (tmp_path / f"breakout-{agent}-{seed}.json").write_text(
                json.dumps({"returns": [total, total + seed]})
            )
    (tmp_path / "freeway-bpn-0.json").write_text(json.dumps({"returns": [1.0]}))
    table = gym_recipe.table(tmp_path)
    assert "| breakout | 20,000 | 0.25 (0.00 to 0.50) | 3.25 (3.00 to 3.50) |" in table
    assert "| 2/2/2 | 75 % |" in table
    assert "freeway" not in table
    left = gym_recipe.missing(tmp_path, ["freeway"], ["random", "bpn"], [0, 1])
    assert [(agent, seed) for _, _, agent, seed in left] == [
        ("random", 0),
        ("random", 1),
        ("bpn", 1),
    ]
