"""The arm of four joints, and the two robots of the paper with both joints turned at once."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_robot_sim import ENVIRONMENTS
from bpn_robot_sim.arm import geometry
from bpn_robot_sim.arm.robot import ArmRobot
from bpn_robot_sim.reaching import additivity
from bpn_robot_sim.reaching.geometry import ROTATIONS_DEG, START_DEG
from bpn_robot_sim.robots import make_robot
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.joint_actions import joined
from bpn_shared.spec.rewards import reward_function

TASK = RunConfig.for_task("arm").task_spec
HOLD = TASK.hold_action
FACTORED = ("reaching_both", "pan_tilt_both", "arm")
choices_of = st.tuples(*[st.integers(0, 6)] * 4)


@pytest.fixture(scope="module")
def arm() -> Any:
    robot = make_robot("arm")
    yield robot
    robot.close()


def step(robot: Any, choices: tuple[int, ...]) -> None:
    robot.command(joined(choices, robot.task.dims))
    robot.settle()


@settings(max_examples=15)
@given(plays=st.lists(choices_of, max_size=6), seed=st.integers(0, 2**63))
def test_the_hand_is_where_the_turns_lead(
    arm: ArmRobot, plays: list[tuple[int, ...]], seed: int
) -> None:
    arm.reset(seed)
    goal = np.array(geometry.start_deg(seed))
    for choices in plays:
        step(arm, choices)
        goal = goal + [geometry.TURNS_DEG[choice] for choice in choices]
    assert arm.commanded_deg == tuple(goal)
    assert arm.info()["joint_deg"] == pytest.approx(goal, abs=0.06)
    assert arm.info()["hand_px"] == pytest.approx(geometry.hand_px(tuple(goal)), abs=0.2)
    away = np.subtract(arm.info()["hand_px"], geometry.TARGET_PX)
    assert arm.reward() == pytest.approx(-np.hypot(*away))


@given(st.integers(0, 2**63))
def test_every_start_shows_the_whole_target_far_from_the_hand(seed: int) -> None:
    start = geometry.start_deg(seed)
    beside = np.subtract(start, geometry.MIDDLE_START_DEG)
    assert np.abs(beside).max() <= geometry.START_SPREAD_DEG
    assert not (beside % geometry.GRID_DEG).any()
    away = np.subtract(geometry.hand_px(start), geometry.TARGET_PX)
    assert np.hypot(*away) > 30


def test_rewards_from_the_pixels_are_the_simulations(arm: ArmRobot) -> None:
    rewards = reward_function(TASK)
    assert rewards is not None
    random = np.random.default_rng(0)
    for seed in range(5):
        frames, told = [arm.reset(seed)], []
        for _ in range(12):
            step(arm, tuple(random.integers(0, 7, 4).tolist()))
            frames.append(arm.frame())
            told.append(arm.reward())
        np.testing.assert_allclose(rewards(np.stack(frames), TASK), told, atol=0.4)


def test_the_target_is_reached_and_held_there(arm: ArmRobot) -> None:
    arm.reset(4)
    for _ in range(40):
        left = np.subtract(geometry.TARGET_POSE_DEG, arm.commanded_deg)
        nearest = [int(np.abs(np.subtract(geometry.TURNS_DEG, one)).argmin()) for one in left]
        step(arm, tuple(nearest))
    assert arm.commanded_deg == geometry.TARGET_POSE_DEG
    frame = arm.frame()
    assert arm.reward() > -0.2
    arm.command(HOLD)
    arm.settle()
    np.testing.assert_array_equal(arm.frame(), frame)


@pytest.mark.parametrize("name", FACTORED)
@pytest.mark.filterwarnings("error")
def test_environments_with_several_dimensions_are_gymnasiums(name: str) -> None:
    env = gymnasium.make(ENVIRONMENTS[name], render_mode="rgb_array")
    check_env(env.unwrapped)
    dims = RunConfig.for_task(name).task_spec.dims
    assert env.action_space == gymnasium.spaces.MultiDiscrete(dims)
    env.reset(seed=1)
    whole = env.step(np.array([1] * len(dims)))[0]
    env.reset(seed=1)
    assert np.array_equal(env.unwrapped.step(joined([1] * len(dims), dims))[0], whole)
    for wrong in ([1] * (len(dims) + 1), [99] + [0] * (len(dims) - 1)):
        with pytest.raises(ValueError, match=r"is outside|argument"):
            env.unwrapped.step(wrong)
    env.close()


@given(first=st.integers(0, 6), second=st.integers(0, 6))
@settings(max_examples=10)
def test_both_joints_of_reaching_turn_at_once(first: int, second: int) -> None:
    robot: Any = make_robot("reaching_both")
    robot.reset(0)
    step(robot, (first, second))
    turned = START_DEG[0] + ROTATIONS_DEG[first], START_DEG[1] + ROTATIONS_DEG[second]
    assert robot.commanded_deg == turned
    robot.close()


def test_pan_tilts_servos_turn_by_themselves() -> None:
    robot: Any = make_robot("pan_tilt_both")
    robot.reset(0)
    step(robot, (4, 1))
    step(robot, (4, 2))
    assert robot.commanded_deg == (8, -2)
    robot.close()


def test_additivity_costs_cvi_a_little_and_no_more_where_its_own_actions_weigh() -> None:
    """Three cells of the table of docs/factored-actions.md."""
    assert additivity.optimum() == pytest.approx(-26.4, abs=0.05)
    exact = additivity.greedy_returns(additivity.Setting(0.95, 49, "own"))
    assert exact[-additivity.LAST :].mean() == pytest.approx(additivity.optimum())
    for weights, expected in (("own", -43.9), ("uniform", -102.6)):
        found = additivity.greedy_returns(additivity.Setting(0.95, 14, weights))  # type: ignore[arg-type]
        assert found[-additivity.LAST :].mean() == pytest.approx(expected, abs=0.05)
