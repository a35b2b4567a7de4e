"""Rewards from pixels: the paper computes them on the server, from what the camera saw (section V-A)."""

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from bpn_shared.markers import HAND_LEVEL, TARGET_LEVEL

Frames = npt.NDArray[np.uint8]
Rewards = npt.NDArray[np.float64]


class RewardError(ValueError):
    """A frame does not show what the reward is computed from; the message names the frame."""


def rewards(task: str, frames: Frames) -> Rewards:
    """r_1..r_T of an episode, unscaled, in the paper's unit: minus the distance in pixels.

    Args:
        task: a name in `bpn_shared.tasks.TASKS`.
        frames: uint8[T+1, c, 84, 84].

    Returns:
        float64[T]; the reward of step t is what frame t+1 shows.

    Raises:
        RewardError: the task has no reward here, the frames have another shape, or a marker is missing.
    """
    if task not in _REWARDS:
        raise RewardError(f"task = {task!r} has no reward; one of: {', '.join(_REWARDS)}")
    return _REWARDS[task](frames)


def reaching_rewards(frames: Frames) -> Rewards:
    """Minus the distance in pixels between the hand and the target.

    The target never moves but may be hidden under the hand or the arm: its place is taken from the first
    frame.

    Args:
        frames: uint8[T+1, 1, 84, 84].

    Returns:
        float64[T].

    Raises:
        RewardError: the frames have another shape, or a marker is missing.
    """
    if frames.dtype != np.uint8 or frames.ndim != 4 or frames.shape[1] != 1 or len(frames) == 0:
        raise RewardError(
            f"frames are {frames.dtype}{list(frames.shape)}, the reaching task has uint8[T+1, 1, h, w]"
        )
    target_px = _centroid_px(frames, 0, TARGET_LEVEL, "target")
    hands_px = [_centroid_px(frames, t, HAND_LEVEL, "hand") for t in range(1, len(frames))]
    offsets_px = np.array(hands_px, np.float64).reshape(-1, 2) - target_px
    return -np.hypot(offsets_px[:, 0], offsets_px[:, 1])


def _centroid_px(frames: Frames, index: int, level: int, name: str) -> tuple[float, float]:
    """(x, y) of the pixels with exactly this gray level."""
    mask = cv2.inRange(frames[index, 0], level, level)
    moments = cv2.moments(mask, binaryImage=True)
    if moments["m00"] == 0:
        raise RewardError(
            f"frame {index} shows no {name} (no pixel of gray level {level}): is the robot's scene the "
            "reaching task's, and the whole arm in view?"
        )
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]


_REWARDS: dict[str, Callable[[Frames], Rewards]] = {"reaching": reaching_rewards}
