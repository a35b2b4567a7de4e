"""Targets over several steps of an episode, unbiased with any policy's data: no importance sampling.

At CVI's fixed point P(s,a) = r + gamma m(s') + alpha (P(s,a) - m(s)) holds for every action, so for the one that
was taken, whatever policy took it, m(s) = r + gamma m(s') - (1 - alpha) (P(s,a) - m(s)) (path consistency; cf.
Nachum et al., 2017). Put in for m(s') again and again, that gives

    y = r_0 + alpha G_0 + sum_{k=1}^{n-1} gamma^k (r_k - (1 - alpha) G_k) + gamma^n m(s_n)
    G_k = P(s_k,a_k) - m(s_k)

whose expectation at the fixed point is P(s_0,a_0) for any n and any actions. With n = 1 it is the paper's target.
DQN has no such equation for actions that are not the best: its sum leaves the correction out, as is usual.
"""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Steps:
    """Of every transition in D, what is known of the next n steps, or of those to its episode's end.

    Attributes:
        reward: sum_k gamma^k (r_k - c_k), c_0 = 0, float[B].
        last: index of the transition whose s' the target bootstraps from, int64[B].
        discount: gamma^n of that s', float[B].
    """

    reward: Tensor
    last: Tensor
    discount: Tensor


def n_step(
    reward: Tensor, steps_left: Tensor, n: int, gamma: float, correction: Tensor | None = None
) -> Steps:
    """Sums up the steps of D's episodes.

    Args:
        reward: r, float[B], an episode's transitions one behind the other.
        steps_left: of the episode, from this transition on, itself counted; int64[B].
        n: at least 1.
        correction: c, what a step's reward is corrected by where it is not a sum's first, float[B].

    Raises:
        ValueError: n is below 1.
    """
    if n < 1:
        raise ValueError(f"n_step = {n} must be at least 1")
    index = torch.arange(len(reward), device=reward.device)
    later = reward if correction is None else reward - correction
    total, discount = reward.clone(), 1.0
    for k in range(1, n):
        discount *= gamma
        there = steps_left > k
        if not bool(there.any()):
            break
        total[there] += discount * later[index[there] + k]
    length = steps_left.clamp(max=n)
    powers = torch.tensor([gamma**k for k in range(1, n + 1)], dtype=reward.dtype)
    return Steps(total, index + length - 1, powers.to(reward.device)[length - 1])
