"""One policy update as the run folder tells it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bpn.verify.play import Policy
from bpn.verify.targets import Played, Targets, targets
from bpn_shared.spec.config import RunConfig


@dataclass(frozen=True, eq=False)
class Update:
    """An iteration's update.

    Attributes:
        record: the iteration's metrics.
        D: its data, the newest data sets in order.
        policy, following: the weights that it began with, and those that it left.
        offset: c of the policy's preferences.
        reward_scale: what is known of it, see `factor_on_rewards`.
    """

    config: RunConfig
    iteration: int
    record: dict[str, Any]
    D: Sequence[Played]
    policy: Policy
    following: Policy
    offset: float
    reward_scale: float

    @property
    def where(self) -> str:
        return f"iteration {self.iteration}"

    def targets(self, config: RunConfig | None = None) -> Targets:
        """What it fits; with another configuration if one is given."""
        config = config or self.config
        return targets(
            config, self.iteration, self.D, self.policy,
            offset=self.offset, reward_scale=config.reward_scale or self.reward_scale or 1.0,
        )  # fmt: skip
