"""The reaching task in numbers: arm, target, start, actions and the camera's pixels.

Pixel coordinates are OpenCV's: x to the right, y down, the centre of the first pixel is (0, 0). The world
is in metres with the arm's base in the origin, x to the right, y up; one pixel is one centimetre.
"""

from math import cos, radians, sin

from bpn_shared.spec.markers import REACHING_TARGET_RADIUS_PX
from bpn_shared.spec.network import IMAGE_SIZE_PX

PX_PER_M = 100.0
BASE_PX = ((IMAGE_SIZE_PX - 1) / 2, (IMAGE_SIZE_PX - 1) / 2)
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

ROTATIONS_DEG = (-90, -45, -30, 0, 30, 45, 90)
ACTIONS_DEG = tuple((d, 0) for d in ROTATIONS_DEG) + tuple((0, d) for d in ROTATIONS_DEG)
"""(Joint 1, joint 2) rotation of each action 0..13."""


def to_px(x_m: float, y_m: float) -> tuple[float, float]:
    """Where a point of the world is in the image."""
    return BASE_PX[0] + PX_PER_M * x_m, BASE_PX[1] - PX_PER_M * y_m


def to_world(x_px: float, y_px: float) -> tuple[float, float]:
    """The inverse of `to_px`, in metres."""
    return (x_px - BASE_PX[0]) / PX_PER_M, (BASE_PX[1] - y_px) / PX_PER_M


def hand_px(q1_deg: float, q2_deg: float) -> tuple[float, float]:
    """The hand in the image at these joint angles: the arm's forward kinematics."""
    first, second = radians(q1_deg), radians(q1_deg + q2_deg)
    length1, length2 = LINK_LENGTHS_PX
    return (
        BASE_PX[0] + length1 * cos(first) + length2 * cos(second),
        BASE_PX[1] - length1 * sin(first) - length2 * sin(second),
    )


TARGET_PX = hand_px(*TARGET_POSE_DEG)
