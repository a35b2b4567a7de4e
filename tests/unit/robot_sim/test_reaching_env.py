"""bpn/Reaching-v0 as a Gymnasium environment."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st

import bpn_robot_sim  # noqa: F401 - registers the environment
from bpn_robot_sim.robots import make_robot
from bpn_shared.spec.tasks import TASKS

TASK = TASKS["reaching"]
ACTIONS = st.lists(st.integers(0, TASK.actions - 1), max_size=20)


@pytest.fixture(scope="module")
def env() -> Iterator[gymnasium.Env[Any, Any]]:
    env = gymnasium.make(TASK.env_id)
    yield env
    env.close()


@pytest.fixture(scope="module")
def other() -> Iterator[gymnasium.Env[Any, Any]]:
    env = gymnasium.make(TASK.env_id)
    yield env
    env.close()


@pytest.mark.filterwarnings("error")
def test_gymnasiums_own_checker_is_content() -> None:
    env = gymnasium.make(TASK.env_id, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@given(actions=ACTIONS, seed=st.integers(0, 2**32 - 1))
def test_reward_is_minus_the_distance_after_the_move(
    env: gymnasium.Env[Any, Any], actions: list[int], seed: int
) -> None:
    env.reset(seed=seed)
    for action in actions:
        _, reward, _, _, info = env.step(action)
        offset = np.subtract(info["hand_px"], info["target_px"])
        assert reward == pytest.approx(-np.linalg.norm(offset))


@given(actions=st.lists(st.integers(0, TASK.actions - 1), min_size=20, max_size=20))
def test_the_time_limit_truncates_and_nothing_terminates(
    env: gymnasium.Env[Any, Any], actions: list[int]
) -> None:
    env.reset()
    ends = [env.step(action)[2:4] for action in actions]
    assert ends == [(False, False)] * 19 + [(False, True)]


@given(actions=ACTIONS)
def test_two_instances_show_the_same(
    env: gymnasium.Env[Any, Any], other: gymnasium.Env[Any, Any], actions: list[int]
) -> None:
    np.testing.assert_array_equal(env.reset(seed=1)[0], other.reset(seed=1)[0])
    for action in actions:
        np.testing.assert_array_equal(env.step(action)[0], other.step(action)[0])


def test_the_bare_environment_has_no_time_limit() -> None:
    env = gymnasium.make(TASK.env_id).unwrapped
    env.reset(seed=0)
    assert not any(any(env.step(np.int64(6))[2:4]) for _ in range(100))
    env.close()


@pytest.mark.parametrize("action", [-1, 14, 10**9])
def test_actions_out_of_range_are_refused(action: int) -> None:
    env = gymnasium.make(TASK.env_id).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=rf"action = {action} is outside 0\.\.13"):
        env.step(action)
    env.close()


def test_actions_that_are_not_integers_are_refused() -> None:
    env = gymnasium.make(TASK.env_id).unwrapped
    env.reset(seed=0)
    with pytest.raises(TypeError, match="float"):
        env.step(2.5)
    env.close()


def test_rendering_is_the_frame_as_rgb() -> None:
    env = gymnasium.make(TASK.env_id, render_mode="rgb_array")
    frame, _ = env.reset(seed=0)
    picture = env.render()
    assert isinstance(picture, np.ndarray)
    np.testing.assert_array_equal(picture, np.stack([frame[0]] * 3, axis=-1))
    env.close()


def expected_random_return() -> float:
    """Of uniformly random actions: the 24 x 24 poses' probabilities, step by step."""
    angles = np.radians(15) * np.arange(24)
    q1, q2 = np.meshgrid(angles, angles, indexing="ij")
    hand = 20 * np.exp(1j * q1) + 18 * np.exp(1j * (q1 + q2))
    distance_px = np.abs(hand - hand[30 // 15, 60 // 15])
    probability = np.zeros((24, 24))
    probability[-90 // 15, -60 // 15] = 1
    total = 0.0
    for _ in range(20):
        shifted = [
            np.roll(probability, turn // 15, axis)
            for axis in (0, 1)
            for turn in (-90, -45, -30, 0, 30, 45, 90)
        ]
        probability = np.mean(shifted, axis=0)
        total -= float(np.sum(probability * distance_px))
    return total


def test_random_play_returns_what_its_markov_chain_predicts(env: gymnasium.Env[Any, Any]) -> None:
    actions = np.random.default_rng(0).integers(TASK.actions, size=(200, 20))
    returns = []
    for episode in actions:
        env.reset(seed=0)
        returns.append(sum(float(env.step(action)[1]) for action in episode))
    expected = expected_random_return()
    assert expected == pytest.approx(-864, abs=1)  # the task page says so
    assert np.mean(returns) == pytest.approx(expected, abs=4 * np.std(returns) / np.sqrt(200))


def test_unknown_tasks_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="task = 'juggling' is unknown"):
        make_robot("juggling")
    monkeypatch.setitem(TASKS, "juggling", replace(TASK, name="juggling"))
    with pytest.raises(ValueError, match="'juggling' has no simulated robot"):
        make_robot("juggling")
