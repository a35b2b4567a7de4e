"""The arm's servos, and the reset that restores everything."""

import hashlib
import subprocess
import sys
from collections.abc import Iterator
from math import degrees

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS

from bpn_robot.robot import RobotFault
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.reaching import geometry, scene
from bpn_robot_sim.reaching.robot import ReachingRobot

TASK = TASKS["reaching"]
ACTIONS = st.lists(st.integers(0, TASK.actions - 1), max_size=20)
TURNS = [-90, -45, -30, 0, 30, 45, 90]


@pytest.fixture(scope="module")
def robot() -> Iterator[ReachingRobot]:
    robot = ReachingRobot(TASKS["reaching"])
    yield robot
    robot.close()


def play(robot: ReachingRobot, actions: list[int], seed: int = 0) -> list[bytes]:
    frames = [robot.reset(seed).tobytes()]
    for action in actions:
        robot.command(action)
        robot.settle()
        frames.append(robot.frame().tobytes())
    return frames


@given(actions=ACTIONS)
def test_commanded_angles_add_up_exactly_and_are_reached(
    robot: ReachingRobot, actions: list[int]
) -> None:
    play(robot, actions)
    goals = (
        geometry.START_DEG[0] + sum(TURNS[a] for a in actions if a < 7),
        geometry.START_DEG[1] + sum(TURNS[a - 7] for a in actions if a >= 7),
    )
    assert robot.commanded_deg == goals
    assert robot.info()["joint_deg"] == pytest.approx(goals, abs=0.1)


def test_hold_actions_leave_the_frame_as_it_is(robot: ReachingRobot) -> None:
    frames = play(robot, [6, TASK.hold_action, 10])
    assert frames[1] == frames[2] == frames[3]


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("elbow_deg", [0, 90, 180])
@pytest.mark.parametrize("turn_deg", [-90, 90])
def test_a_right_angle_settles_within_the_control_period_without_overshoot(
    joint: int, elbow_deg: int, turn_deg: int
) -> None:
    physics = Physics(scene.mjcf())
    physics.data.qpos[1] = physics.data.ctrl[1] = np.radians(elbow_deg)
    goals_deg = np.array([0, elbow_deg])
    goals_deg[joint] += turn_deg
    physics.data.ctrl[:] = np.radians(goals_deg)
    beyond_deg = []
    for _ in range(round(TASK.control_period_s / physics.timestep_s)):
        physics.advance(physics.timestep_s)
        beyond_deg.append(
            (degrees(physics.data.qpos[joint]) - goals_deg[joint]) * np.sign(turn_deg)
        )
    assert max(beyond_deg) < 1.0
    assert np.degrees(physics.data.qpos) == pytest.approx(goals_deg, abs=0.1)


@given(periods=st.lists(st.floats(0, 0.05), max_size=50))
def test_time_advances_by_what_was_asked_in_whole_steps(periods: list[float]) -> None:
    physics = Physics(scene.mjcf())
    for seconds in periods:
        physics.advance(seconds)
    assert physics.data.time == pytest.approx(sum(periods), abs=physics.timestep_s / 2 + 1e-9)


@pytest.mark.parametrize("seconds", [-0.1, float("nan"), float("inf")])
def test_impossible_durations_are_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="seconds = "):
        Physics(scene.mjcf()).advance(seconds)


def test_a_robot_that_cannot_settle_is_an_error() -> None:
    with pytest.raises(RobotFault, match="did not settle within"):
        Physics(scene.mjcf()).advance_until(lambda: False, check_every_steps=50)


@given(action=st.one_of(st.integers(max_value=-1), st.integers(min_value=14)))
def test_unknown_actions_are_refused_and_move_nothing(robot: ReachingRobot, action: int) -> None:
    before = robot.commanded_deg
    with pytest.raises(ValueError, match=r"is outside 0\.\.13, the actions of 'reaching'"):
        robot.command(action)
    assert robot.commanded_deg == before


@given(
    earlier=ACTIONS,
    actions=ACTIONS,
    seeds=st.tuples(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1)),
    interrupted_s=st.floats(0, 0.1),
)
def test_reset_forgets_everything(
    robot: ReachingRobot,
    earlier: list[int],
    actions: list[int],
    seeds: tuple[int, int],
    interrupted_s: float,
) -> None:
    expected = play(robot, actions, seeds[0])
    truth = robot.info()
    play(robot, earlier)
    robot.command(0)
    robot.advance(interrupted_s)  # reset in the middle of a motion
    assert play(robot, actions, seeds[1]) == expected
    assert robot.info() == truth


def test_realtime_play_is_repeatable_after_reset(robot: ReachingRobot) -> None:
    def periods() -> list[bytes]:
        frames = [robot.reset(0).tobytes()]
        for action in (0, 13, 3, 5, 8):
            robot.command(action)
            robot.advance(0.0112)  # no whole number of time steps, nor are all five together
            frames.append(robot.frame().tobytes())
        return frames

    assert periods() == periods()


def test_a_fresh_process_sees_the_same_frames(robot: ReachingRobot) -> None:
    actions = [0, 13, 8, 6, 4, 9, 2, 11]
    program = (
        "import hashlib; from bpn_robot_sim.robots import make_robot\n"
        "robot = make_robot('reaching'); digest = hashlib.sha256(robot.reset(0).tobytes())\n"
        f"for action in {actions}:\n"
        "    robot.command(action); robot.settle(); digest.update(robot.frame().tobytes())\n"
        "print(digest.hexdigest())"
    )
    fresh = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    here = hashlib.sha256(b"".join(play(robot, actions))).hexdigest()
    assert fresh.stdout.strip() == here
