"""Rewards of episodes: from what the camera saw (the paper, section V-A), or as the robot told them."""

from functools import lru_cache

from bpn_shared.messages.episode import Episode
from bpn_shared.spec.rewards import RewardFunction, Rewards, reward_function
from bpn_shared.spec.tasks import TaskSpec


def episode_rewards(task: TaskSpec, episode: Episode) -> Rewards:
    """r_1..r_T of an episode, unscaled.

    Raises:
        RewardError: the frames do not show what the reward is computed from.
        PluginError: what computes them is not installed here, or broken.
    """
    function = function_of(task)
    return episode.rewards if function is None else function(episode.frames, task)


@lru_cache(maxsize=8)
def function_of(task: TaskSpec) -> RewardFunction | None:
    """What computes the task's rewards from pixels; None where the robot tells them.

    Raises:
        PluginError: it is not installed here, or cannot be imported.
    """
    return reward_function(task)
