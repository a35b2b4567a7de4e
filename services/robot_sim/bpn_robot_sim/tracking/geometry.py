"""The tracking task in numbers: world, window, the target's motion, actions and the camera's pixels.

Positions in the world are in pixels from its upper left corner, x to the right, y down; in MuJoCo one pixel
is one centimetre and y is up. Positions in the image are OpenCV's: the centre of the first pixel is (0, 0).
"""

from math import cos, radians, sin

import numpy as np

from bpn_shared.spec.framing import MIDDLE_PX
from bpn_shared.spec.network import IMAGE_SIZE_PX
from bpn_shared.spec.tasks import TASKS

PX_PER_M = 100.0
WORLD_WIDTH_PX, WORLD_HEIGHT_PX = 180, 120
WINDOW_Y_PX = WORLD_HEIGHT_PX / 2
WINDOW_LIMITS_PX = (IMAGE_SIZE_PX / 2, WORLD_WIDTH_PX - IMAGE_SIZE_PX / 2)
"""Of the window's centre in x: the window stays in the world."""

TARGET_RADIUS_PX = 12.0
ARC_RADIUS_PX = 60.0
ARC_CENTRE_PX = (WORLD_WIDTH_PX / 2, 90.0)
"""The upper half circle around it puts the disc's lowest and highest points on the window's border."""
DEG_PER_STEP = 6.0
"""Forty steps are 240 degrees, in which the target sweeps at least 90 px in x: more than a window that
stands still can see. In one step it moves at most 6.3 px in x: less than the window can."""
DEG_PER_S = DEG_PER_STEP / TASKS["tracking"].control_period_s

ACTIONS_PX = (-8, -4, -2, 0, 2, 4, 8)
"""How far each action 0..6 moves the window. The paper prints 2 twice; the first must be -2."""


def target_world_px(phase_deg: float) -> tuple[float, float]:
    """The target in the world: to and fro on the half circle, once in 360 degrees."""
    x_px, y_px = ARC_CENTRE_PX
    phase = radians(phase_deg)
    return x_px + ARC_RADIUS_PX * sin(phase), y_px - ARC_RADIUS_PX * abs(cos(phase))


def to_image(world_px: tuple[float, float], window_x_px: float) -> tuple[float, float]:
    """Where the window with its centre at that x shows a point of the world."""
    return world_px[0] - window_x_px + MIDDLE_PX, world_px[1] - WINDOW_Y_PX + MIDDLE_PX


def to_world_m(world_px: tuple[float, float]) -> tuple[float, float]:
    """A point of the world in MuJoCo's coordinates."""
    return world_px[0] / PX_PER_M, -world_px[1] / PX_PER_M


def start_limits_px(target_x_px: float) -> tuple[float, float]:
    """The window's centres in x at which it shows the whole target."""
    slack_px = IMAGE_SIZE_PX / 2 - TARGET_RADIUS_PX
    lowest_px, highest_px = WINDOW_LIMITS_PX
    return max(lowest_px, target_x_px - slack_px), min(highest_px, target_x_px + slack_px)


def clipped_to_world(window_x_px: float) -> float:
    """The nearest centre at which the window is in the world."""
    lowest_px, highest_px = WINDOW_LIMITS_PX
    return min(max(window_x_px, lowest_px), highest_px)


def start(seed: int) -> tuple[float, float]:
    """The start that belongs to a seed: the target's phase (degrees) and the window's centre in x (px)."""
    random = np.random.default_rng(seed)
    phase_deg = float(random.uniform(0, 360))
    target_x_px, _ = target_world_px(phase_deg)
    return phase_deg, float(random.uniform(*start_limits_px(target_x_px)))
