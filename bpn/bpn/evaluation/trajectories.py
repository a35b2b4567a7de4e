"""Where hand, target and camera were, from what the camera saw and what the robot was told."""

import numpy as np
import numpy.typing as npt

from bpn_robot_sim.pan_tilt import geometry
from bpn_shared.messages.episode import Episode
from bpn_tasks.framing import MIDDLE_PX
from bpn_tasks.markers import PAN_TILT_MARKER, TRACKING_TARGET
from bpn_tasks.paths import target_path_px

Path = npt.NDArray[np.float64]
"""float64[T+1, 2], one position for each frame."""

_TARGETS = {"tracking": TRACKING_TARGET, "pan_tilt": PAN_TILT_MARKER}


def target_offsets_px(task: str, episode: Episode) -> Path:
    """The target from the frame's middle in pixels, x to the right, y down.

    Raises:
        KeyError: the task has no target that moves in the frame.
    """
    return target_path_px(episode.frames, _TARGETS[task]) - MIDDLE_PX


def gaze_deg(episode: Episode) -> Path:
    """Where pan_tilt's camera was told to point, (pan, tilt): its turns summed up, within its limits."""
    limits = np.array(geometry.AGENT_LIMITS_DEG)
    angles = [np.zeros(2)]
    for choices in episode.actions.reshape(episode.steps, -1).tolist():
        turned = angles[-1] + geometry.turns_deg(tuple(choices))
        angles.append(np.clip(turned, -limits, limits))
    return np.array(angles)


def seen_direction_deg(gaze: Path, offsets_px: Path) -> Path:
    """The direction, (pan, tilt), in which a camera at these angles sees what is at these offsets."""
    return np.array(
        [
            geometry.aim_deg(_ray(pan, tilt, x_px, y_px))
            for (pan, tilt), (x_px, y_px) in zip(
                np.radians(gaze).tolist(), offsets_px.tolist(), strict=True
            )
        ]
    )


def figure_deg(points: int = 400) -> Path:
    """The marker's figure-8 as the agent has to follow it, (pan, tilt); float64[points, 2]."""
    phases = np.linspace(0, 360, points)
    return np.array(
        [
            geometry.aim_deg(geometry.marker_m(geometry.target_deg(phase)))
            for phase in phases.tolist()
        ]
    )


def _ray(pan: float, tilt: float, x_px: float, y_px: float) -> tuple[float, float, float]:
    """A point on the ray through a pixel, in the world; angles in radians."""
    right = np.array([np.cos(pan), np.sin(pan), 0.0])
    up = np.array([np.sin(pan) * np.sin(tilt), -np.cos(pan) * np.sin(tilt), np.cos(tilt)])
    forward = np.array([-np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt), np.sin(tilt)])
    x_m, y_m, z_m = (
        forward + (x_px * right - y_px * up) / geometry.FOCAL_PX  # image y is down
    ).tolist()
    return x_m, y_m, z_m
