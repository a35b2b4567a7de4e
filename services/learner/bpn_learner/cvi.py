"""Conservative Value Iteration: its operators and targets, on tensors, nothing else.

The paper's names: P is the action preference, alpha the GIO coefficient, beta the inverse temperature,
gamma the discount factor; P- is P of the target network. All functions keep the dtype of their inputs.

An action of several dimensions has preferences P(s,a) = sum_d P_d(s,a_d), side by side: `dims` says how many each
dimension has. Every operator here is then the sum of what it is of each dimension (docs/factored-actions.md).
"""

from collections.abc import Sequence

import torch
from torch import Tensor

NO_FLOOR = float("inf")


def mellowmax(P: Tensor, beta: float, dims: Sequence[int] = ()) -> Tensor:
    """(m_beta P)(s) = 1/beta log mean_a exp(beta P(s,a)) (section III-B).

    Written as top + 1/beta log1p(mean expm1(beta (P - top))) with top = max_a P: no exponent is above 0,
    so nothing overflows, and nothing cancels when beta is small.

    Args:
        P: preferences [..., |A|].
        beta: above 0; infinity would be the maximum, 0 the mean.
        dims: choices of each dimension of the actions; none is one of |A|.

    Returns:
        [...].
    """
    first, *others = by_dimension(P, dims)
    m = _mellowmax(first, beta)
    for part in others:
        m = m + _mellowmax(part, beta)
    return m


def _mellowmax(P: Tensor, beta: float) -> Tensor:
    top = P.amax(dim=-1, keepdim=True)
    excess = torch.expm1(beta * (P - top)).mean(dim=-1)
    return top.squeeze(-1) + torch.log1p(excess) / beta


def best(P: Tensor, dims: Sequence[int] = ()) -> Tensor:
    """max_a P(s,a), [...]; arguments as of `mellowmax`."""
    first, *others = by_dimension(P, dims)
    top = first.amax(dim=-1)
    for part in others:
        top = top + part.amax(dim=-1)
    return top


def taken(P: Tensor, action: Tensor, dims: Sequence[int] = ()) -> Tensor:
    """P(s,a), [B].

    Args:
        P: P(s, .) [B, |A|].
        action: int64[B]; where there are several dimensions, int64[B, D], the choice of each.
    """
    if action.ndim == 1:
        return P.gather(-1, action.unsqueeze(-1)).squeeze(-1)
    return P.gather(-1, outputs_taken(action, dims)).sum(dim=-1)


def outputs_taken(action: Tensor, dims: Sequence[int]) -> Tensor:
    """Which of the preferences side by side belong to an action: int64[B, D] to int64[B, D]."""
    starts = torch.tensor([0, *dims[:-1]], device=action.device).cumsum(0)
    return action + starts


def cvi_gap(
    P_s: Tensor,
    action: Tensor,
    *,
    beta: float,
    floor: float = NO_FLOOR,
    dims: Sequence[int] = (),
) -> tuple[Tensor, Tensor]:
    """What an action's preference is above the state's value, P(s,a) - (m_beta P)(s).

    Args:
        P_s, action, dims: as of `taken`.
        floor: how far below 0 it counts, at most.

    Returns:
        The difference [B], and the same from -floor on [B].
    """
    gap = taken(P_s, action, dims) - mellowmax(P_s, beta, dims)
    return gap, gap if floor == NO_FLOOR else gap.clamp_min(-floor)


def cvi_target(
    reward: Tensor,
    P_s: Tensor,
    action: Tensor,
    P_next: Tensor,
    *,
    alpha: float,
    beta: float,
    gamma: float | Tensor,
    done: Tensor | None = None,
    terminal: float | Tensor = 0.0,
    floor: float = NO_FLOOR,
    dims: Sequence[int] = (),
) -> Tensor:
    """Target y = r + gamma (m_beta P-)(s') + alpha (P-(s,a) - (m_beta P-)(s)), section IV-C.

    With a floor f, the last term is alpha max(P-(s,a) - (m_beta P-)(s), -f), as Munchausen-DQN clips log-policies
    (Vieillard et al., 2020): no gap widens beyond what it is worth in one step plus alpha f, so a network of few
    levels need not express gaps of actions that are never taken.

    Args:
        reward: r [B]; of several steps, see `n_step`.
        P_s: P-(s, .) [B, |A|].
        action: a, int64 [B], or [B, D] of D dimensions.
        P_next: P-(s', .) [B, |A|].
        gamma: of s', one or [B].
        done: s' is terminal, [B], bool or 0/1; its value is then `terminal`. None: Algorithm 1 as printed,
            which bootstraps from every s'.
        terminal: what no further reward is worth; 0 unless preferences are relative.
        floor: of the gap, above 0.
        dims: choices of each dimension of the actions.

    Returns:
        y [B].
    """
    _, floored = cvi_gap(P_s, action, beta=beta, floor=floor, dims=dims)
    gap = alpha * floored  # G(s,a), the gap increasing operator
    return reward + gamma * _unless(done, mellowmax(P_next, beta, dims), terminal) + gap


def dqn_target(
    reward: Tensor,
    P_next: Tensor,
    *,
    gamma: float | Tensor,
    done: Tensor | None = None,
    terminal: float | Tensor = 0.0,
    dims: Sequence[int] = (),
) -> Tensor:
    """Target y = r + gamma max_a P-(s',a) of the paper's BQN. Shapes as in `cvi_target`."""
    return reward + gamma * _unless(done, best(P_next, dims), terminal)


def by_dimension(P: Tensor, dims: Sequence[int]) -> Sequence[Tensor]:
    """P_d(s, .) of every dimension, views of P [..., |A|]."""
    return torch.split(P, list(dims), dim=-1) if len(dims) > 1 else (P,)


def _unless(done: Tensor | None, value: Tensor, terminal: float | Tensor) -> Tensor:
    if done is None:
        return value
    if isinstance(terminal, Tensor):
        return torch.where(done.bool(), terminal, value)
    return value.masked_fill(done.bool(), terminal)
