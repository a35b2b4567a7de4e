"""The arm task in numbers: links, start, targets and turns; pixels and world as of `planar_arm.scene`."""

from math import cos, radians, sin

from bpn_robot_sim.planar_arm.scene import BASE_PX
from bpn_tasks.factored import ARM_TURNS_DEG
from bpn_tasks.markers import ARM_HAND_RADIUS_PX, REACHING_TARGET_RADIUS_PX

LINK_LENGTHS_PX = (12.0, 10.0, 9.0, 8.0)
"""With the hand's radius they sum to 42, half the image: the workspace touches its border."""
LINK_WIDTH_PX = 4.0
HAND_RADIUS_PX = ARM_HAND_RADIUS_PX
TARGET_RADIUS_PX = REACHING_TARGET_RADIUS_PX

START_DEG = (-120, 20, 20, 20)
"""Below the base, bent a little."""
TARGET_ANGLES_DEG = (45.0, 135.0)
TARGET_DISTANCES_PX = (20.0, 34.0)
"""Of a target from the base, above it: the arm can reach all of them, and covers none at the start."""

TURNS_DEG = ARM_TURNS_DEG
"""Of a joint, by choice."""


def hand_px(joint_deg: tuple[float, ...]) -> tuple[float, float]:
    """The hand in the image at these joint angles: the arm's forward kinematics."""
    x_px, y_px = BASE_PX
    angle = 0.0
    for turn, length_px in zip(joint_deg, LINK_LENGTHS_PX, strict=True):
        angle += radians(turn)
        x_px, y_px = x_px + length_px * cos(angle), y_px - length_px * sin(angle)
    return x_px, y_px


def target_px(angle_deg: float, distance_px: float) -> tuple[float, float]:
    """A target in the image at this direction and distance from the base."""
    angle = radians(angle_deg)
    return BASE_PX[0] + distance_px * cos(angle), BASE_PX[1] - distance_px * sin(angle)
