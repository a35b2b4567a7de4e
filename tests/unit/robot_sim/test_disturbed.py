"""Robots whose cameras and servos are disturbed."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS

from bpn.testing import check_robot
from bpn_robot.disturbed import DisturbedRobot
from bpn_robot.robots import make_robot
from bpn_robot_sim.backlash import Backlash
from bpn_robot_sim.reaching.robot import ReachingRobot
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.disturbances import parse
from bpn_shared.spec.tasks import TaskSpec


def disturbed(task: TaskSpec, levels: str) -> TaskSpec:
    return task.model_copy(update={"disturbances": parse(levels)})


@pytest.mark.parametrize("name", TASKS)
def test_a_disturbed_robot_is_a_robot(name: str) -> None:
    task = disturbed(TASKS[name], "noise=0..25,offset=-30..30,jpeg=30..90,backlash=0..3")
    check_robot(make_robot(task), steps=16)


def test_any_environment_is_disturbed() -> None:
    pytest.importorskip("gymnasium")
    task = RunConfig.for_task("gym:CartPole-v1", actions=2).task_spec
    check_robot(make_robot(disturbed(task, "noise=10")), steps=10)
    with pytest.raises(ConfigError, match="have no backlash to choose; leave it out"):
        make_robot(disturbed(task, "backlash=1"))


def test_what_is_off_wraps_nothing() -> None:
    robot = make_robot(TASKS["reaching"])
    try:
        assert isinstance(robot, ReachingRobot)
    finally:
        robot.close()


def test_a_frame_is_the_same_however_often_it_is_asked_for() -> None:
    robot = make_robot(disturbed(TASKS["reaching"], "noise=25"))
    try:
        assert isinstance(robot, DisturbedRobot)
        first = robot.reset(3)
        assert np.array_equal(robot.frame(), first)
        robot.command(3)
        robot.settle()
        held = robot.frame()
        assert np.array_equal(robot.frame(), held)
        assert not np.array_equal(held, first)  # nothing moved but the noise
    finally:
        robot.close()


@given(
    play=st.floats(0, 45),
    goals=st.lists(st.floats(-90, 90), min_size=1, max_size=20),
    seed=st.integers(0, 2**64 - 1),
)
def test_an_output_is_within_half_the_play_of_its_goal_and_moves_no_more_than_it_must(
    play: float, goals: list[float], seed: int
) -> None:
    servo = Backlash({"backlash": (play, play)}, seed, [0.0])
    before = 0.0
    for goal in goals:
        (output,) = servo.output([goal])
        assert abs(output - goal) <= play / 2 + 1e-9
        assert output == before or abs(output - goal) == pytest.approx(play / 2, abs=1e-9)
        before = output
    exact: Any = Backlash({}, seed, [0.0])
    assert [exact.output([goal]) for goal in goals] == [[goal] for goal in goals]


def test_reaching_with_play_ends_elsewhere() -> None:
    ends = []
    for levels in ("", "backlash=10"):
        robot = make_robot(disturbed(TASKS["reaching"], levels))
        try:
            robot.reset(1)
            for action in (6, 2):
                robot.command(action)
                robot.settle()
            ends.append(robot.info()["joint_deg"])
        finally:
            robot.close()
    # there 5 degrees of it were used up, back 10
    assert ends[0] == pytest.approx((-30, -60), abs=0.1)
    assert ends[1] == pytest.approx((-25, -60), abs=0.1)
