"""Whether an episode succeeded: said only where the task, or the robot, defines it."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from bpn_shared.messages.episode import EpisodeMeta
from bpn_shared.spec.markers import REACHING_TARGET_RADIUS_PX
from bpn_shared.spec.tasks import Task


def success_of(task: Task, meta: EpisodeMeta, rewards: npt.NDArray[np.floating]) -> bool | None:
    """Whether the episode did what the task is about; None where nobody defines it.

    Args:
        rewards: [T], unscaled.
    """
    match task.success:
        case "kept":
            return not meta.terminated
        case "reached":
            return bool(rewards[-1] >= -REACHING_TARGET_RADIUS_PX)
        case "told":
            return meta.success


def share(successes: Iterable[bool | None]) -> float | None:
    """Successes among the episodes for which they are defined; None if there is no such episode."""
    defined = [success for success in successes if success is not None]
    return sum(defined) / len(defined) if defined else None
