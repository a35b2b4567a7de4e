"""Conservative Value Iteration: its operators and targets, on tensors, nothing else.

The paper's names: P is the action preference, alpha the GIO coefficient, beta the inverse temperature,
gamma the discount factor; P- is P of the target network. All functions keep the dtype of their inputs.
"""

import torch
from torch import Tensor


def mellowmax(P: Tensor, beta: float) -> Tensor:
    """(m_beta P)(s) = 1/beta log mean_a exp(beta P(s,a)) (section III-B).

    Written as top + 1/beta log1p(mean expm1(beta (P - top))) with top = max_a P: no exponent is above 0,
    so nothing overflows, and nothing cancels when beta is small.

    Args:
        P: preferences [..., |A|].
        beta: above 0; infinity would be the maximum, 0 the mean.

    Returns:
        [...].
    """
    top = P.amax(dim=-1, keepdim=True)
    excess = torch.expm1(beta * (P - top)).mean(dim=-1)
    return top.squeeze(-1) + torch.log1p(excess) / beta


def cvi_target(
    reward: Tensor,
    P_s: Tensor,
    action: Tensor,
    P_next: Tensor,
    *,
    alpha: float,
    beta: float,
    gamma: float,
    done: Tensor | None = None,
    terminal: float = 0.0,
) -> Tensor:
    """Target y = r + gamma (m_beta P-)(s') + alpha (P-(s,a) - (m_beta P-)(s)), section IV-C.

    Args:
        reward: r [B].
        P_s: P-(s, .) [B, |A|].
        action: a, int64 [B].
        P_next: P-(s', .) [B, |A|].
        done: s' is terminal, [B], bool or 0/1; its value is then `terminal`. None: Algorithm 1 as printed,
            which bootstraps from every s'.
        terminal: what no further reward is worth; 0 unless preferences are relative.

    Returns:
        y [B].
    """
    taken = P_s.gather(-1, action.unsqueeze(-1)).squeeze(-1)
    gap = alpha * (taken - mellowmax(P_s, beta))  # G(s,a), the gap increasing operator
    return reward + gamma * _unless(done, mellowmax(P_next, beta), terminal) + gap


def dqn_target(
    reward: Tensor,
    P_next: Tensor,
    *,
    gamma: float,
    done: Tensor | None = None,
    terminal: float = 0.0,
) -> Tensor:
    """Target y = r + gamma max_a P-(s',a) of the paper's BQN. Shapes as in `cvi_target`."""
    return reward + gamma * _unless(done, P_next.amax(dim=-1), terminal)


def _unless(done: Tensor | None, value: Tensor, terminal: float) -> Tensor:
    return value if done is None else value.masked_fill(done.bool(), terminal)
