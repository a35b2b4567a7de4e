"""What a policy does over D: how undecided it is, and how much an update changed it."""

from collections.abc import Sequence

import torch
from torch import Tensor

from bpn_learner.cvi import by_dimension


def entropy(P: Tensor, beta: float, dims: Sequence[int] = ()) -> float:
    """Mean entropy of softmax(beta P) in nats, of several dimensions their sum; a uniform policy has log |A|.

    Args:
        P: P(s, .) [n, |A|].
        beta: inverse temperature.
        dims: choices of each dimension of the actions; none is one of |A|.
    """
    total = torch.zeros((), dtype=torch.float64, device=P.device)
    for part in by_dimension(P, dims):
        log_pi = torch.log_softmax(beta * part.double(), dim=-1)
        total += -(log_pi.exp() * log_pi).sum(dim=-1).mean()
    return float(total)


def agreement(before: Tensor, after: Tensor, dims: Sequence[int] = ()) -> float:
    """The share of states in which the greedy action is the same by two P(s, .) [n, |A|]."""
    same = torch.ones(len(before), dtype=torch.bool, device=before.device)
    pairs = zip(by_dimension(before, dims), by_dimension(after, dims), strict=True)
    for old, new in pairs:
        same &= old.argmax(dim=-1) == new.argmax(dim=-1)
    return float(same.double().mean())
