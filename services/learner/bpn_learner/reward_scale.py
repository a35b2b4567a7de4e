"""What rewards are multiplied by before learning: what a run asks for, or what its first data ask for."""

from collections.abc import Sequence

import torch

from bpn_learner.n_step import n_step
from bpn_learner.transitions import EpisodeData
from bpn_shared.spec.config import RunConfig

RANGE = 10.0
"""Of the scaled returns over n steps: beta = 1 then means the same whatever unit rewards have."""


class RewardScale:
    """A run's factor on rewards.

    Args:
        config: whose `reward_scale` is the factor, or 0: it is found out.
        found: what was found out in an earlier attempt; 0: nothing yet.

    Attributes:
        found: the factor; 0 as long as it is not known.
    """

    def __init__(self, config: RunConfig, found: float = 0.0) -> None:
        self._n, self._gamma = config.n_step, config.gamma
        self.found = config.reward_scale or found

    def of(self, D: Sequence[EpisodeData]) -> float:
        """The factor for an update over D.

        Once a D has returns that differ it stays: preferences are in that unit. Before, every action is as good as
        any other whatever the factor, and it is 1.
        """
        self.found = self.found or found_in(D, self._n, self._gamma)
        return self.found or 1.0


def found_in(D: Sequence[EpisodeData], n: int, gamma: float) -> float:
    """What makes the range of D's returns over n steps `RANGE`; 0 where all are equal."""
    rewards = torch.cat([torch.from_numpy(episode.rewards).double() for episode in D])
    steps_left = torch.cat([torch.arange(len(e.rewards), 0, -1) for e in D])
    returns = n_step(rewards, steps_left, n, gamma).reward
    spread = float(returns.max() - returns.min())
    return RANGE / spread if spread > 0 else 0.0
