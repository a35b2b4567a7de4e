"""What computes rewards from pixels: a function of frames and task, a plug-in of the group bpn.rewards."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from bpn_shared.errors import InputError
from bpn_shared.plugins import REWARDS, find
from bpn_shared.spec.tasks import TaskSpec

Frames = npt.NDArray[np.uint8]
"""uint8[T+1, c, 84, 84]."""
Rewards = npt.NDArray[np.float64]
"""float64[T]; the reward of step t is what frame t+1 shows."""


class RewardError(InputError):
    """A frame does not show what the reward is computed from; the message names the frame."""


class RewardFunction(Protocol):
    """r_1..r_T of an episode, unscaled.

    Raises `RewardError` where the frames do not show what the reward is computed from.
    """

    def __call__(self, frames: Frames, task: TaskSpec, /) -> Rewards: ...


def reward_function(task: TaskSpec) -> RewardFunction | None:
    """The task's, checked to return what it should; None where the robot tells rewards.

    Raises:
        PluginError: it is not installed here, or cannot be imported.
    """
    if task.rewards is None:
        return None
    plugin = find(REWARDS, task.rewards)
    plugin.load()

    def rewards(frames: Frames, task: TaskSpec, /) -> Rewards:
        told = plugin.call(frames, task)
        try:
            found = np.asarray(told, np.float64)
        except (TypeError, ValueError) as error:
            raise plugin.broken(f"it returned what are no numbers: {error}") from error
        if found.shape != (len(frames) - 1,):
            raise plugin.broken(
                f"it returned {list(found.shape)} rewards for {len(frames)} frames, not [{len(frames) - 1}]"
            )
        return found

    return rewards
