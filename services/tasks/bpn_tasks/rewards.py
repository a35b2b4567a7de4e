"""Rewards from pixels: the paper computes them on the server, from what the camera saw (section V-A)."""

import numpy as np

from bpn_shared.spec.disturbances import of_scope
from bpn_shared.spec.rewards import Frames, Rewards
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.framing import reward_px
from bpn_tasks.markers import PAN_TILT_MARKER, TRACKING_TARGET, Disc
from bpn_tasks.paths import reaching_path_px, target_path_px


def reaching(frames: Frames, task: TaskSpec) -> Rewards:
    """See `reaching_rewards`."""
    return reaching_rewards(frames, exact=not _disturbed(task))


def tracking(frames: Frames, task: TaskSpec) -> Rewards:
    """See `framing_rewards`."""
    return framing_rewards(frames, TRACKING_TARGET, exact=not _disturbed(task))


def pan_tilt(frames: Frames, task: TaskSpec) -> Rewards:
    """See `framing_rewards`."""
    return framing_rewards(frames, PAN_TILT_MARKER, exact=not _disturbed(task))


def _disturbed(task: TaskSpec) -> bool:
    return bool(of_scope(task.disturbances, "picture"))


def reaching_rewards(frames: Frames, *, exact: bool = True) -> Rewards:
    """Minus the distance in pixels between the hand and the target.

    The target never moves but may be hidden under the hand or the arm: its place is taken from the first
    frame.

    Args:
        frames: uint8[T+1, 1, 84, 84].
        exact: see `reaching_path_px`.

    Returns:
        float64[T].

    Raises:
        RewardError: the frames have another shape, or a marker is missing.
    """
    target_px, hands_px = reaching_path_px(frames, exact=exact)
    offsets_px = hands_px[1:] - target_px
    return -np.hypot(offsets_px[:, 0], offsets_px[:, 1])


def framing_rewards(frames: Frames, target: Disc, *, exact: bool = True) -> Rewards:
    """Minus the distance in pixels between the target's centre and the frame's.

    Args:
        frames: uint8[T+1, 3, 84, 84].
        target: what the target looks like.
        exact: see `target_path_px`.

    Returns:
        float64[T].

    Raises:
        RewardError: the frames have another shape, or the first one shows no target.
    """
    path_px = target_path_px(frames, target, exact=exact)
    return np.array([reward_px(x_px, y_px) for x_px, y_px in path_px[1:].tolist()], np.float64)
