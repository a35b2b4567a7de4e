"""What the minibatches of an update are taken from: each observation's frames stand in memory once."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from bpn_learner.group import SINGLE_PROCESS, Group
from bpn_learner.minibatch import Gradients, minibatch_gradients
from bpn_learner.networks import PNetwork
from bpn_learner.transitions import Transitions, gather_observations
from bpn_shared.spec.sections import Backend

GATHERED_BYTES = 2**29
"""Observations that take no more are gathered once for all minibatches, which is faster by what copying costs."""


@dataclass(frozen=True, eq=False)
class RegressionBatch:
    """What the minibatches of an update fit P to.

    Attributes:
        frames: uint8[m, c, rows, columns].
        observations: int64[n, frames_stacked], frame indices as in `Transitions`.
        actions: int64[n]; of several dimensions int64[n, D], the outputs that each action takes.
        y: float32[n], the target of P(s, a).
    """

    frames: Tensor
    observations: Tensor
    actions: Tensor
    y: Tensor

    def with_pictures(self, again: Transitions) -> Self:
        """The same and once more with the pictures of transitions that are D's otherwise."""
        later = again.observations + len(self.frames)
        return type(self)(
            frames=torch.cat([self.frames, again.frames]),
            observations=torch.cat([self.observations, later]),
            actions=torch.cat([self.actions, self.actions]),
            y=torch.cat([self.y, self.y]),
        )

    def parts(self, size: int) -> Iterator[Tensor]:
        """Its observations, `size` at once, uint8[n, C, rows, columns] each."""
        return (
            gather_observations(self.frames, part) for part in torch.split(self.observations, size)
        )


def gathered_gradients(
    backend: Backend,
    network: PNetwork,
    regression: RegressionBatch,
    batch_size: int,
    *,
    group: Group = SINGLE_PROCESS,
    at_once_bytes: int = GATHERED_BYTES,
) -> Gradients:
    """`minibatch_gradients` over all of D, to the same bits however its observations are gathered.

    Args:
        batch_size: of the largest minibatch.
        at_once_bytes: observations that take more are gathered anew for each minibatch.
    """
    frames, stacks = regression.frames, regression.observations
    if stacks.numel() * frames[0].numel() <= at_once_bytes:
        everything = gather_observations(frames, stacks)
        return minibatch_gradients(
            backend, network, everything, regression.actions, regression.y, group=group
        )
    # Where the minibatch in work is: the kernel is made for arrays that stay where they are.
    rows = torch.arange(batch_size, device=frames.device)
    pixels = gather_observations(frames, stacks[:1]).expand(batch_size, -1, -1, -1)
    pixels = pixels.contiguous(memory_format=torch.channels_last)
    actions, y = (
        of.new_zeros((batch_size, *of.shape[1:])) for of in (regression.actions, regression.y)
    )
    of_minibatch = minibatch_gradients(backend, network, pixels, actions, y, group=group)

    def gradients(batch: Tensor) -> Tensor | float:
        size = len(batch)
        pixels[:size] = gather_observations(frames, stacks[batch])
        actions[:size], y[:size] = regression.actions[batch], regression.y[batch]
        return of_minibatch(rows[:size])

    return gradients
