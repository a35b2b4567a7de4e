"""bpn/Tracking-v0 and bpn/PanTilt-v0 as Gymnasium environments."""

from collections.abc import Callable, Iterator
from math import hypot
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from paper import TASKS

import bpn_robot_sim  # noqa: F401 - registers the environments
from bpn_robot_sim import ENVIRONMENTS, baselines
from bpn_robot_sim.robots import make_robot

Env = gymnasium.Env[Any, Any]

BOTH = pytest.mark.parametrize("name", ["tracking", "pan_tilt"])
STEPS = {"tracking": 40, "pan_tilt": 80}  # T, the paper's sections V-A-2 and VI-B
plays = st.lists(st.integers(0, 2**16), max_size=30)
seeds = st.integers(0, 2**63 - 1)


@pytest.fixture(scope="module")
def env_of() -> Iterator[Callable[[str, int], Env]]:
    """Makes each environment once, or twice for comparisons."""
    made: dict[tuple[str, int], Env] = {}

    def get(name: str, copy: int = 0) -> Env:
        if (name, copy) not in made:
            made[name, copy] = gymnasium.make(ENVIRONMENTS[name])
        return made[name, copy]

    yield get
    for env in made.values():
        env.close()


@BOTH
@pytest.mark.filterwarnings("error")
def test_gymnasiums_own_checker_is_content(name: str) -> None:
    env = gymnasium.make(ENVIRONMENTS[name], render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@BOTH
def test_spaces_are_the_papers(name: str, env_of: Callable[..., Env]) -> None:
    env = env_of(name)
    assert env.observation_space == gymnasium.spaces.Box(0, 255, (3, 84, 84), np.uint8)
    assert env.action_space == gymnasium.spaces.Discrete({"tracking": 7, "pan_tilt": 17}[name])
    assert TASKS[name].network(100).channels == 6


@BOTH
@settings(max_examples=25)
@given(actions=plays, seed=seeds)
def test_two_instances_show_the_same(
    env_of: Callable[..., Env], name: str, actions: list[int], seed: int
) -> None:
    first, second = env_of(name), env_of(name, 1)
    np.testing.assert_array_equal(first.reset(seed=seed)[0], second.reset(seed=seed)[0])
    for number in actions:
        action = number % TASKS[name].actions
        frame, reward, terminated, truncated, info = first.step(action)
        other, *rest = second.step(action)
        np.testing.assert_array_equal(frame, other)
        assert rest == [reward, terminated, truncated, info]
        if terminated or truncated:
            break


@BOTH
def test_the_seed_decides_the_start(name: str, env_of: Callable[..., Env]) -> None:
    env = env_of(name)
    starts = [env.reset(seed=seed)[0].tobytes() for seed in range(20)]
    assert len(set(starts)) == 20
    assert starts == [env.reset(seed=seed)[0].tobytes() for seed in range(20)]


@BOTH
def test_without_a_seed_every_episode_starts_elsewhere_but_repeatably(
    name: str, env_of: Callable[..., Env]
) -> None:
    def starts() -> list[bytes]:
        env = env_of(name)
        return [env.reset(seed=7)[0].tobytes(), *(env.reset()[0].tobytes() for _ in range(5))]

    once = starts()
    assert len(set(once)) == 6
    assert starts() == once


@BOTH
@settings(max_examples=50)
@given(actions=plays, seed=seeds)
def test_reward_and_end_follow_from_the_targets_place(
    env_of: Callable[..., Env], name: str, actions: list[int], seed: int
) -> None:
    env = env_of(name)
    env.reset(seed=seed)
    for number in actions:
        _, reward, terminated, truncated, info = env.step(number % TASKS[name].actions)
        x, y = info["target_px"]
        assert terminated == (not (0 <= x <= 83 and 0 <= y <= 83))
        assert not truncated
        nearest = (min(max(x, 0), 83), min(max(y, 0), 83))
        assert reward == pytest.approx(-hypot(nearest[0] - 41.5, nearest[1] - 41.5))
        if terminated:
            break


@BOTH
def test_greedy_play_lasts_until_the_time_limit(name: str, env_of: Callable[..., Env]) -> None:
    env = env_of(name)
    robot: Any = env.unwrapped
    for seed in range(10):
        env.reset(seed=seed)
        ends = [env.step(robot.robot.greedy_action())[2:4] for _ in range(STEPS[name])]
        assert ends == [(False, False)] * (STEPS[name] - 1) + [(False, True)]


@BOTH
def test_standing_still_and_random_play_lose_the_target(name: str) -> None:
    robot: Any = make_robot(name)
    held = [baselines.play(robot, "hold", seed, STEPS[name]) for seed in range(100)]
    random = [baselines.play(robot, "random", seed, STEPS[name]) for seed in range(100)]
    robot.close()
    assert all(episode.lost and episode.steps < STEPS[name] for episode in held)
    assert np.mean([episode.lost for episode in random]) > 0.95


@BOTH
def test_rendering_is_the_frame_as_rgb(name: str) -> None:
    env = gymnasium.make(ENVIRONMENTS[name], render_mode="rgb_array")
    frame, _ = env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), frame.transpose(1, 2, 0))
    env.close()


@BOTH
def test_actions_out_of_range_are_refused(name: str, env_of: Callable[..., Env]) -> None:
    env = env_of(name).unwrapped
    env.reset(seed=0)
    for action in (-1, TASKS[name].actions):
        with pytest.raises(ValueError, match=f"action = {action} is outside 0"):
            env.step(action)


def test_the_command_prints_what_play_gives(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["references", "tracking", "--episodes", "2"])
    baselines.main()
    lines = {line.split()[0]: line.split() for line in capsys.readouterr().out.splitlines()[1:]}
    robot: Any = make_robot("tracking")
    for policy, line in lines.items():
        episodes = [baselines.play(robot, policy, seed, 40) for seed in range(2)]  # type: ignore[arg-type]
        assert float(line[1]) == pytest.approx(np.mean([e.return_px for e in episodes]), abs=0.06)
    robot.close()
    assert set(lines) == {"greedy", "random", "hold"}
