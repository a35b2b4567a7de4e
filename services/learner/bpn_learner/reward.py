"""Rewards from pixels: the paper computes them on the server, from what the camera saw (section V-A)."""

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from bpn_learner.disc import disc_centre_px
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.framing import nearest_on_border, reward_px
from bpn_shared.spec.markers import HAND_LEVEL, PAN_TILT_MARKER, TARGET_LEVEL, TRACKING_TARGET, Disc
from bpn_shared.spec.network import IMAGE_SIZE_PX
from bpn_shared.spec.tasks import Task

Frames = npt.NDArray[np.uint8]
Rewards = npt.NDArray[np.float64]
Positions = npt.NDArray[np.float64]


class RewardError(ValueError):
    """A frame does not show what the reward is computed from; the message names the frame."""


def episode_rewards(task: Task, episode: Episode) -> Rewards:
    """r_1..r_T of an episode, unscaled: from its pixels, or as the robot told them where the task says so.

    Raises:
        RewardError: the frames do not show what the reward is computed from.
    """
    return episode.rewards if task.rewards == "robot" else rewards(task.name, episode.frames)


def rewards(task: str, frames: Frames) -> Rewards:
    """r_1..r_T of an episode, unscaled, in the paper's unit: minus the distance in pixels.

    Args:
        task: a name in `bpn_shared.spec.tasks.TASKS`.
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
    target_px, hands_px = reaching_path_px(frames)
    offsets_px = hands_px[1:] - target_px
    return -np.hypot(offsets_px[:, 0], offsets_px[:, 1])


def reaching_path_px(frames: Frames) -> tuple[Positions, Positions]:
    """Where the target is and where the hand is in every frame, from the pixels.

    Args:
        frames: uint8[T+1, 1, 84, 84].

    Returns:
        float64[2] and float64[T+1, 2], (x, y) in pixels.

    Raises:
        RewardError: the frames have another shape, or a marker is missing.
    """
    _check(frames, channels=1)
    target_px = _centroids_px(frames[:1, 0], TARGET_LEVEL, "target")[0]
    return target_px, _centroids_px(frames[:, 0], HAND_LEVEL, "hand")


def framing_rewards(frames: Frames, target: Disc) -> Rewards:
    """Minus the distance in pixels between the target's centre and the frame's.

    Args:
        frames: uint8[T+1, 3, 84, 84].
        target: what the target looks like.

    Returns:
        float64[T].

    Raises:
        RewardError: the frames have another shape, or the first one shows no target.
    """
    path_px = target_path_px(frames, target)
    return np.array([reward_px(x_px, y_px) for x_px, y_px in path_px[1:].tolist()], np.float64)


def target_path_px(frames: Frames, target: Disc) -> Positions:
    """Where the target's centre is in every frame, from the pixels.

    Where the border cuts the target, its centre is that of the disc fitted to what is left. A centre
    outside, in the last frame of a lost target, counts as the nearest point of the border. A target of
    which nothing is left counts as the point of the border nearest to where it was seen last.

    Args:
        frames: uint8[T+1, 3, 84, 84].
        target: what the target looks like.

    Returns:
        float64[T+1, 2], (x, y) in pixels.

    Raises:
        RewardError: the frames have another shape, or the first one shows no target.
    """
    _check(frames, channels=3)
    colour = np.array(target.rgb, np.uint8)[:, None, None]
    seen_px: tuple[float, float] | None = None
    path_px: list[tuple[float, float]] = []
    for frame in frames:
        mask = (frame == colour).all(axis=0).astype(np.uint8)
        centre_px = disc_centre_px(mask, target.radius_px)
        if centre_px is not None:
            seen_px = centre_px
        elif seen_px is None:
            raise RewardError(
                f"frame 0 shows no target (no pixel of colour {target.rgb}): is the robot's scene this task's?"
            )
        else:
            seen_px = nearest_on_border(*seen_px)
        path_px.append(seen_px)
    return np.array(path_px, np.float64)


def _centroids_px(images: Frames, level: int, name: str) -> Positions:
    """Of the pixels with exactly this gray level in each image uint8[n, 84, 84]: float64[n, 2], (x, y).

    Markers are a few pixels of thousands, so it pays to look for them once in all images.
    """
    index, pixel = np.divmod(np.flatnonzero(images == level), images[0].size)
    y_px, x_px = np.divmod(pixel, images.shape[-1])
    count = np.bincount(index, minlength=len(images))
    if not count.all():
        raise RewardError(
            f"frame {int(np.argmin(count))} shows no {name} (no pixel of gray level {level}): is the robot's "
            "scene the reaching task's, and the whole arm in view?"
        )
    sums_px = [np.bincount(index, of_px, len(images)) for of_px in (x_px, y_px)]
    return np.stack(sums_px, axis=1) / count[:, None]


def _check(frames: Frames, channels: int) -> None:
    expected = (channels, IMAGE_SIZE_PX, IMAGE_SIZE_PX)
    if frames.dtype != np.uint8 or frames.shape[1:] != expected or len(frames) == 0:
        raise RewardError(
            f"frames are {frames.dtype}{list(frames.shape)}, the task has uint8[T+1, "
            f"{', '.join(map(str, expected))}]"
        )


_REWARDS: dict[str, Callable[[Frames], Rewards]] = {
    "reaching": reaching_rewards,
    "tracking": partial(framing_rewards, target=TRACKING_TARGET),
    "pan_tilt": partial(framing_rewards, target=PAN_TILT_MARKER),
}
