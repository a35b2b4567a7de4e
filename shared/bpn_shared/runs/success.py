"""Whether an episode succeeded: said only where the task, or the robot, defines it."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from bpn_shared.messages.episode import EpisodeMeta
from bpn_shared.spec.tasks import TaskSpec


def success_of(task: TaskSpec, meta: EpisodeMeta, rewards: npt.NDArray[np.floating]) -> bool | None:
    """Whether the episode did what the task is about; None where nobody defines it.

    Args:
        rewards: [T], unscaled.
    """
    match task.success:
        case "not_terminated":
            return not meta.terminated
        case "last_reward" if task.success_reward is not None:
            return bool(rewards[-1] >= task.success_reward)
        case "told":
            return meta.success
    return None


def share(successes: Iterable[bool | None]) -> float | None:
    """Successes among the episodes for which they are defined; None if there is no such episode."""
    defined = [success for success in successes if success is not None]
    return sum(defined) / len(defined) if defined else None
