"""One policy update, done again: shuffles, minibatches, gradients, learning rates."""

import copy
import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from bpn.verify.targets import Targets
from bpn.verify.trainee import Trainee
from bpn_learner import _native
from bpn_shared.spec.config import RunConfig

Gradients = Callable[[Tensor], float]
"""Sets every parameter's `grad` from the transitions int64[B] of a minibatch, and returns their loss."""


def learning_rate_factors(config: RunConfig, iteration: int, size: int) -> list[list[float]]:
    """Of the learning rate, for every step of every epoch: a line over the run, a cosine over each update.

    The cosine falls from epoch to epoch, or from step to step where `max_updates` may end an epoch.

    Args:
        size: of D.
    """
    line = 1 + iteration / max(1, config.iterations - 1) * (config.lr_run_final_factor - 1)
    final, of_epoch = config.lr_update_final_factor, minibatches(size, config.batch_size)
    count = updates(config, size)
    parts = count if config.max_updates else config.epochs

    def factor(step: int) -> float:
        done = step if config.max_updates else step // of_epoch
        cosine = (1 + math.cos(math.pi * (done / max(1, parts - 1)))) / 2
        return line * (final + (1 - final) * cosine)

    return [
        [factor(step) for step in range(begin, min(begin + of_epoch, count))]
        for begin in range(0, count, of_epoch)
    ]


def updates(config: RunConfig, size: int) -> int:
    """Optimizer steps of an update over D of that size."""
    whole = config.epochs * minibatches(size, config.batch_size)
    return min(whole, config.max_updates) if config.max_updates else whole


def minibatches(size: int, batch: int) -> int:
    """In an epoch: size / batch, rounded, halves down, at least one. What is left over sits the epoch out."""
    return max(1, math.ceil(size / batch - 0.5))


def autograd(trainee: Trainee, data: Targets) -> Gradients:
    """By torch's autograd: of 1/2 mean (y - P(s, a))^2."""

    def gradients(rows: Tensor) -> float:
        P = trainee.forward(data.seen[rows])
        taken = P.gather(1, data.taken[rows]).sum(dim=1)
        loss = (data.y[rows] - taken).square().sum() / (2 * len(rows))
        trainee.adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        return float(loss.detach())

    return gradients


def compiled(trainee: Trainee, data: Targets) -> Gradients:
    """By the learner's C++ kernel, whose rounding nothing else has; `gap` compares it with autograd."""
    path = _native.available_paths()[0]
    layers = [
        (layer.in_size, layer.in_channels, layer.kernel, layer.stride, layer.out_channels)
        for layer in trainee.spec.layers
    ]
    slopes = [torch.zeros_like(p) for p in trainee.parameters]
    for parameter, slope in zip(trainee.parameters, slopes, strict=True):
        parameter.grad = slope
    # the kernel reads parameters and writes gradients in place
    values, written = ([v.detach().numpy() for v in of] for of in (trainee.parameters, slopes))
    seen, taken, y = data.seen.numpy(), data.taken.numpy(), data.y.numpy()
    if not trainee.binary:
        of_floats = _native.FloatKernel(path, layers)
        return lambda rows: of_floats.gradients(
            seen, rows.numpy(), taken, y, values[0], values[1], written[0], written[1], len(rows)
        )
    kernel = _native.Kernel(path, layers)

    def gradients(rows: Tensor) -> float:
        loss, slope = kernel.gradients(
            seen, rows.numpy(), taken, y, values[0], values[1], values[2], trainee.log_scale.item(),
            written[0], written[1], written[2], len(rows), None,
        )  # fmt: skip
        slopes[3].fill_(slope)
        return loss

    return gradients


def gap(trainee: Trainee, data: Targets, rows: Tensor) -> float:
    """How far the kernel's gradients of a minibatch are from autograd's in float64, relative to their norm."""
    exact, single = copy.deepcopy(trainee).double(), copy.deepcopy(trainee)
    autograd(exact, data)(rows)
    compiled(single, data)(rows)
    found, expected = (
        torch.cat([p.grad.flatten().double() for p in t.parameters if p.grad is not None])
        for t in (single, exact)
    )
    return float((found - expected).norm() / expected.norm().clamp_min(1e-12))


def train(
    trainee: Trainee,
    data: Targets,
    gradients: Gradients,
    *,
    factors: list[list[float]],
    batch_size: int,
    shuffles: np.random.Generator,
    on_epoch: Callable[[], None] = lambda: None,
    turned: int = 0,
) -> list[float]:
    """The epochs of one update.

    Args:
        factors: of the learning rate, for each step of each epoch.
        turned: by how many places every minibatch is turned: the same sums in another order, rounded otherwise.

    Returns:
        The mean loss of every epoch.
    """
    losses = []
    for of_epoch in factors:
        order, total = torch.from_numpy(shuffles.permutation(len(data.y))), torch.zeros(())
        for k, factor in enumerate(of_epoch):
            total += gradients(order[batch_size * k : batch_size * (k + 1)].roll(turned))
            trainee.step(factor)
        losses.append(float(total) / len(of_epoch))
        on_epoch()
    return losses
