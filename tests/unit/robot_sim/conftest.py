"""Robots that are made once: starting OpenGL costs more than most tests."""

from collections.abc import Iterator

import pytest
from paper import TASKS

from bpn_robot_sim.pan_tilt.robot import PanTiltRobot
from bpn_robot_sim.tracking.robot import TrackingRobot


@pytest.fixture(scope="module")
def tracking_robot() -> Iterator[TrackingRobot]:
    robot = TrackingRobot(TASKS["tracking"])
    yield robot
    robot.close()


@pytest.fixture(scope="module")
def pan_tilt_robot() -> Iterator[PanTiltRobot]:
    robot = PanTiltRobot(TASKS["pan_tilt"])
    yield robot
    robot.close()
