"""The arm task in numbers: links, starts, target and turns; pixels and world as of `planar_arm.scene`."""

from math import cos, radians, sin

import numpy as np

from bpn_robot_sim.planar_arm.scene import BASE_PX
from bpn_tasks.factored import ARM_TURNS_DEG
from bpn_tasks.markers import REACHING_TARGET_RADIUS_PX

LINK_LENGTHS_PX = (12.0, 10.0, 9.0, 8.0)
"""With the hand's radius they sum to 42, half the image: the workspace touches its border."""
LINK_WIDTH_PX = 4.0
HAND_RADIUS_PX = 3.0
TARGET_RADIUS_PX = REACHING_TARGET_RADIUS_PX

GRID_DEG = 5
"""Every angle of a joint is a multiple of it."""
MIDDLE_START_DEG = (-120, 20, 20, 20)
"""Below the base, bent a little; starts are up to `START_SPREAD_DEG` beside it, in each joint."""
START_SPREAD_DEG = 30
TARGET_POSE_DEG = (40, 20, 20, 20)
"""A pose of the grid whose hand is on the target, far from all starts; of many."""

TURNS_DEG = ARM_TURNS_DEG
"""Of a joint, by choice."""


def start_deg(seed: int) -> tuple[int, ...]:
    """The joints' angles where the episode of that seed begins."""
    most = START_SPREAD_DEG // GRID_DEG
    beside = np.random.default_rng(seed).integers(-most, most + 1, len(MIDDLE_START_DEG))
    return tuple(
        middle + GRID_DEG * steps
        for middle, steps in zip(MIDDLE_START_DEG, beside.tolist(), strict=True)
    )


def hand_px(joint_deg: tuple[float, ...]) -> tuple[float, float]:
    """The hand in the image at these joint angles: the arm's forward kinematics."""
    x_px, y_px = BASE_PX
    angle = 0.0
    for turn, length_px in zip(joint_deg, LINK_LENGTHS_PX, strict=True):
        angle += radians(turn)
        x_px, y_px = x_px + length_px * cos(angle), y_px - length_px * sin(angle)
    return x_px, y_px


TARGET_PX = hand_px(TARGET_POSE_DEG)
