"""The pan-tilt task in numbers: the two units, the marker's figure-8, actions and the camera's pixels.

World in metres: the camera, on both of the agent's axes, is in the origin and looks along y at zero angles;
x is to the right, z up. Positive pan turns either unit to the camera's left, positive tilt raises what it
carries, so the agent follows the target with angles of the same sign. Pixels are OpenCV's.
"""

from math import asin, atan2, cos, degrees, hypot, radians, sin, tan

import numpy as np
import numpy.typing as npt

from bpn_shared.spec.network import IMAGE_SIZE_PX
from bpn_tasks.factored import PAN_TILT_TURNS_DEG
from bpn_tasks.framing import MIDDLE_PX
from bpn_tasks.specs import CONTROL_PERIOD_S

Angles = tuple[float, float]
"""(Pan, tilt)."""

FOV_DEG = 30.0
FOCAL_PX = IMAGE_SIZE_PX / 2 / tan(radians(FOV_DEG / 2))
DISTANCE_M = 1.0
"""From the camera to the target unit's axes."""
BOOM_M = 0.5
"""From there to the marker, towards the camera. Half the distance: to the camera the marker moves by about
the angles of its own unit, 21 by 14 degrees at the most, beyond the 15 that a still camera sees."""
MARKER_RADIUS_M = 0.035

FIGURE_DEG = (25.0, 15.0)
STEPS_PER_FIGURE = 80
"""The figure-8 is passed once in an episode: w = 0.54 rad/s."""
PHASE_PER_S = 360.0 / (STEPS_PER_FIGURE * CONTROL_PERIOD_S)
"""w in degrees."""

AGENT_LIMITS_DEG = (40.0, 30.0)
"""Nowhere beyond them does the camera see the marker; the backdrop fills its frame up to here."""

_TURNS_DEG = tuple(n for n in PAN_TILT_TURNS_DEG if n)
ACTIONS_DEG = (
    *((0, n) for n in PAN_TILT_TURNS_DEG),
    *((n, 0) for n in _TURNS_DEG),
    *((-n, n) for n in _TURNS_DEG),
    *((n, n) for n in _TURNS_DEG),
)
"""(Pan, tilt) of each action 0..16. The paper prints (n,-n) for the last four, which are the four before."""
WAYS = (len(ACTIONS_DEG),), (len(PAN_TILT_TURNS_DEG),) * 2
"""Choices of each dimension of a task's actions: the paper's, or each servo by itself."""


def turns_deg(choices: tuple[int, ...]) -> Angles:
    """How far an action turns the units' goals."""
    if len(choices) == 1:
        return ACTIONS_DEG[choices[0]]
    pan, tilt = choices
    return PAN_TILT_TURNS_DEG[pan], PAN_TILT_TURNS_DEG[tilt]


def target_deg(phase_deg: float) -> Angles:
    """The target unit's goal, 25 sin wt and 15 sin 2wt."""
    phase = radians(phase_deg)
    return FIGURE_DEG[0] * sin(phase), FIGURE_DEG[1] * sin(2 * phase)


def target_deg_per_s(phase_deg: float) -> Angles:
    """The goal's speed."""
    phase, per_s = radians(phase_deg), radians(PHASE_PER_S)
    return FIGURE_DEG[0] * per_s * cos(phase), 2 * FIGURE_DEG[1] * per_s * cos(2 * phase)


def marker_m(unit_deg: Angles) -> tuple[float, float, float]:
    """The marker in the world at these angles of its unit."""
    pan, tilt = radians(unit_deg[0]), radians(unit_deg[1])
    return (
        -BOOM_M * sin(pan) * cos(tilt),
        DISTANCE_M - BOOM_M * cos(pan) * cos(tilt),
        BOOM_M * sin(tilt),
    )


def aim_deg(point_m: tuple[float, float, float]) -> Angles:
    """The agent's angles at which the point is in the middle of the frame."""
    x_m, y_m, z_m = point_m
    return degrees(atan2(-x_m, y_m)), degrees(asin(z_m / hypot(x_m, y_m, z_m)))


def to_image(
    point_m: npt.NDArray[np.float64],
    camera_m: npt.NDArray[np.float64],
    axes: npt.NDArray[np.float64],
) -> tuple[float, float]:
    """Where a pinhole camera sees a point in front of it.

    Args:
        point_m, camera_m: float64[3], in the world.
        axes: float64[3, 3], the camera's right, up and backward axes as columns.
    """
    right_m, up_m, backward_m = (axes.T @ (point_m - camera_m)).tolist()
    scale = FOCAL_PX / -backward_m
    return MIDDLE_PX + scale * right_m, MIDDLE_PX - scale * up_m
