"""Batch norm with the statistics of the whole minibatch, also where a group of learners shares it."""

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from bpn_learner.group import Group

BATCH_NORM_EPSILON = 1e-5


def batch_norm(o: Tensor, gamma: Tensor, beta: Tensor, group: Group) -> Tensor:
    """Normalizes each channel over all members' images and positions.

    torch's SyncBatchNorm does this on GPUs alone.

    Args:
        o: float[B, channels, h, w], this member's part of the minibatch; B may be 0 in a group.
        gamma, beta: float[channels].
    """
    if group.size == 1:
        return functional.batch_norm(
            o, None, None, gamma, beta, training=True, eps=BATCH_NORM_EPSILON
        )
    normalized: Tensor = _SharedBatchNorm.apply(o, gamma, beta, group)  # type: ignore[no-untyped-call]
    return normalized


class _SharedBatchNorm(torch.autograd.Function):
    """What `functional.batch_norm` computes, with its sums added up over the group, in both directions."""

    @staticmethod
    def forward(ctx: Any, o: Tensor, gamma: Tensor, beta: Tensor, group: Group) -> Tensor:
        """Sums of integers and of their squares are exact in double, however the minibatch is shared."""
        double = o.double()
        count = double.new_full((1,), o.numel() // o.shape[1])
        total, values, squares = _added_up(group, count, double.sum((0, 2, 3)), _squares(double))
        mean = values / total
        variance = (squares / total - mean.square()).clamp_min(0)
        scale = torch.rsqrt(variance + BATCH_NORM_EPSILON)
        normalized = ((double - _wide(mean)) * _wide(scale)).to(o.dtype)
        ctx.save_for_backward(normalized, gamma, scale, total)
        ctx.group = group
        return normalized * _wide(gamma) + _wide(beta)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        """The gradients of gamma and beta are this member's part, as all gradients are."""
        (g,) = gradients
        normalized, gamma, scale, total = ctx.saved_tensors
        d_beta = g.double().sum((0, 2, 3))
        d_gamma = (g * normalized).double().sum((0, 2, 3))
        values, products = _added_up(ctx.group, d_beta, d_gamma)
        mean, slope = (values / total).to(g.dtype), (products / total).to(g.dtype)
        slopes = g - _wide(mean) - _wide(slope) * normalized
        d_o = _wide(gamma * scale.to(g.dtype)) * slopes
        return d_o, d_gamma.to(g.dtype), d_beta.to(g.dtype), None


def _added_up(group: Group, *sums: Tensor) -> tuple[Tensor, ...]:
    """The sums over the group, in one exchange."""
    together = torch.cat(sums)
    group.all_reduce_sum(together)
    return torch.split(together, [len(part) for part in sums])


def _squares(values: Tensor) -> Tensor:
    return values.square().sum((0, 2, 3))


def _wide(channels: Tensor) -> Tensor:
    return channels[:, None, None]
