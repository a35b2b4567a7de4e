"""The reaching task in numbers: arm, target, start, actions and the camera's pixels.

Pixels and the world are those of `planar_arm.scene`.
"""

from math import cos, radians, sin

from bpn_robot_sim.planar_arm.scene import BASE_PX
from bpn_tasks.factored import REACHING_TURNS_DEG
from bpn_tasks.markers import REACHING_TARGET_RADIUS_PX

LINK_LENGTHS_PX = (20.0, 18.0)
"""With the hand's radius they sum to 42, half the image: the workspace touches its border."""
LINK_WIDTH_PX = 5.0
HAND_RADIUS_PX = 4.0
TARGET_RADIUS_PX = REACHING_TARGET_RADIUS_PX

GRID_DEG = 15
"""Every rotation is a multiple of it: from the start the arm reaches 24 x 24 poses."""
START_DEG = (-90, -60)
TARGET_POSE_DEG = (30, 60)
"""The one pose of the grid whose hand is on the target; the optimum is there after four moves."""

ROTATIONS_DEG = REACHING_TURNS_DEG
ACTIONS_DEG = tuple((d, 0) for d in ROTATIONS_DEG) + tuple((0, d) for d in ROTATIONS_DEG)
"""(Joint 1, joint 2) rotation of each action 0..13."""


def hand_px(q1_deg: float, q2_deg: float) -> tuple[float, float]:
    """The hand in the image at these joint angles: the arm's forward kinematics."""
    first, second = radians(q1_deg), radians(q1_deg + q2_deg)
    length1, length2 = LINK_LENGTHS_PX
    return (
        BASE_PX[0] + length1 * cos(first) + length2 * cos(second),
        BASE_PX[1] - length1 * sin(first) - length2 * sin(second),
    )


TARGET_PX = hand_px(*TARGET_POSE_DEG)
