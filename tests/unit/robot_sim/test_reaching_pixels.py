"""What the learner measures in a frame is what the simulation knows."""

import cmath
from collections.abc import Iterator
from math import dist, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_robot.frame import Frame
from bpn_robot_sim.reaching import geometry
from bpn_robot_sim.reaching.robot import ReachingRobot
from bpn_shared.spec import markers
from bpn_shared.spec.tasks import TASKS

ACTIONS = st.lists(st.integers(0, TASKS["reaching"].actions - 1), max_size=20)


@pytest.fixture(scope="module")
def robot() -> Iterator[ReachingRobot]:
    robot = ReachingRobot()
    yield robot
    robot.close()


def centroid_px(frame: Frame, level: int) -> tuple[float, float]:
    rows, columns = np.nonzero(frame[0] == level)
    return float(columns.mean()), float(rows.mean())


def play(robot: ReachingRobot, actions: list[int]) -> Frame:
    frame = robot.reset(seed=0)
    for action in actions:
        robot.command(action)
        robot.settle()
        frame = robot.frame()
    return frame


@given(actions=ACTIONS)
def test_hand_is_found_within_half_a_pixel_and_never_hidden(
    robot: ReachingRobot, actions: list[int]
) -> None:
    frame = play(robot, actions)
    assert dist(centroid_px(frame, markers.HAND_LEVEL), robot.info()["hand_px"]) < 0.5
    area = np.count_nonzero(frame == markers.HAND_LEVEL)
    assert area == pytest.approx(np.pi * geometry.HAND_RADIUS_PX**2, rel=0.15)


@given(actions=ACTIONS)
def test_hand_in_pixels_is_the_arms_forward_kinematics(
    robot: ReachingRobot, actions: list[int]
) -> None:
    play(robot, actions)
    q1, q2 = (radians(angle) for angle in robot.info()["joint_deg"])
    hand = 20 * cmath.rect(1, q1) + 18 * cmath.rect(1, q1 + q2)
    assert robot.info()["hand_px"] == pytest.approx((41.5 + hand.real, 41.5 - hand.imag), abs=1e-6)


@settings(max_examples=30)
@given(seconds=st.floats(0, 0.2), action=st.integers(0, 13))
def test_frame_and_truth_agree_while_the_arm_moves(
    robot: ReachingRobot, seconds: float, action: int
) -> None:
    robot.reset(seed=0)
    robot.command(action)
    robot.advance(seconds)
    frame = robot.frame()
    assert dist(centroid_px(frame, markers.HAND_LEVEL), robot.info()["hand_px"]) < 0.5


def test_target_is_whole_in_the_first_frame(robot: ReachingRobot) -> None:
    frame = robot.reset(seed=0)
    found = centroid_px(frame, markers.TARGET_LEVEL)
    assert dist(found, robot.info()["target_px"]) < 0.25
    area = np.count_nonzero(frame == markers.TARGET_LEVEL)
    assert area == pytest.approx(np.pi * geometry.TARGET_RADIUS_PX**2, rel=0.1)


@given(actions=ACTIONS)
def test_only_the_four_gray_levels_appear(robot: ReachingRobot, actions: list[int]) -> None:
    levels = {
        markers.BACKGROUND_LEVEL,
        markers.ARM_LEVEL,
        markers.TARGET_LEVEL,
        markers.HAND_LEVEL,
    }
    assert set(np.unique(play(robot, actions)).tolist()) <= levels


@given(actions=ACTIONS)
def test_frame_is_new_contiguous_uint8_of_the_tasks_shape(
    robot: ReachingRobot, actions: list[int]
) -> None:
    frame = play(robot, actions)
    assert frame.dtype == np.uint8
    assert frame.shape == robot.task.frame_shape
    assert frame.flags.c_contiguous
    kept = frame.copy()
    robot.command(0)
    robot.settle()
    assert not np.array_equal(robot.frame(), kept)
    assert np.array_equal(frame, kept)
