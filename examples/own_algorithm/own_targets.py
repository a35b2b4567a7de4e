"""Hedged Q-learning: what it learns. The learner alone imports this."""

from torch import Tensor

from bpn_learner.targets import TargetInputs, TargetSettings


def hedged(data: TargetInputs, settings: TargetSettings) -> Tensor:
    """Y = r + gamma ((1 - hedge) max_a P-(s', a) + hedge mean_a P-(s', a)), float32[n]."""
    hedge = settings.options["hedge"]
    follows = (1 - hedge) * data.P_next.amax(dim=1) + hedge * data.P_next.mean(dim=1)
    if data.done is not None:
        follows = follows.masked_fill(data.done, data.terminal)
    return data.reward + settings.gamma * follows
