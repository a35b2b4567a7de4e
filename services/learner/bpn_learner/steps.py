"""One optimizer step from a minibatch; on a GPU as one graph, which is launched at once.

A step is some 150 operators, each shorter than its launch. Captured, they cost one launch together.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

import torch
from torch import Tensor

from bpn_learner.group import SINGLE_PROCESS, Group
from bpn_learner.minibatch import Gradients
from bpn_learner.networks import PNetwork

Step = Callable[[Tensor], Tensor | float]
"""Trains the network on the transitions int64[B] of D, and returns their mean loss."""


def plain_step(gradients: Gradients, network: PNetwork, optimizer: torch.optim.Optimizer) -> Step:
    """Operator by operator."""

    def step(batch: Tensor) -> Tensor | float:
        loss = gradients(batch)
        optimizer.step()
        network.clip_latent_weights()
        return loss

    return step


class Recorder(Protocol):
    """Keeps work on fixed tensors, to do it again at once."""

    def warm_up(self, work: Callable[[], Tensor]) -> Tensor:
        """Does it as recording needs it to have been done before."""

    def record(self, work: Callable[[], Tensor]) -> tuple[Callable[[], None], Tensor]:
        """Without doing it: what does it, and where its result will be."""


class CudaGraphs:
    """Work on the GPU as CUDA graphs."""

    def __init__(self) -> None:
        self._aside = torch.cuda.Stream()  # type: ignore[no-untyped-call]

    def warm_up(self, work: Callable[[], Tensor]) -> Tensor:
        """On a stream aside, where torch wants what is captured later."""
        self._aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._aside):
            result = work()
        torch.cuda.current_stream().wait_stream(self._aside)
        return result

    def record(self, work: Callable[[], Tensor]) -> tuple[Callable[[], None], Tensor]:
        """One graph."""
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            result = work()
        return graph.replay, result


class RecordedStep:
    """A step that is recorded after its first times, one recording for each size of minibatch.

    The first times are steps like all others, so that nothing is done that a plain step would not do.

    Args:
        step: whose loss is a tensor.
        optimizer: `recordable` while this is used.
    """

    WARM_UPS = 3

    def __init__(self, step: Step, recorder: Recorder) -> None:
        self._step, self._recorder = step, recorder
        self._batches: dict[int, Tensor] = {}
        self._times: dict[int, int] = {}
        self._recorded: dict[int, tuple[Callable[[], None], Tensor]] = {}

    def __call__(self, batch: Tensor) -> Tensor:
        """As `Step`; the loss is valid until the next call."""
        size = len(batch)
        given = self._batches.setdefault(size, torch.empty_like(batch)).copy_(batch)
        done = self._times[size] = self._times.get(size, 0) + 1
        if done <= self.WARM_UPS:
            return self._recorder.warm_up(lambda: self._loss(given))
        if size not in self._recorded:
            self._recorded[size] = self._recorder.record(lambda: self._loss(given))
        replay, loss = self._recorded[size]
        replay()
        return loss

    def _loss(self, batch: Tensor) -> Tensor:
        return torch.as_tensor(self._step(batch))


@contextmanager
def recordable(optimizer: torch.optim.Optimizer) -> Iterator[None]:
    """The learning rates are tensors meanwhile, and no step waits for the GPU."""
    groups = optimizer.param_groups
    for group in groups:
        group["lr"] = torch.tensor(group["lr"], device=group["params"][0].device)
        group["capturable"] = True
    try:
        yield
    finally:
        for group in groups:
            group["lr"], group["capturable"] = group["initial_lr"], False


@contextmanager
def best_step(
    gradients: Gradients,
    network: PNetwork,
    optimizer: torch.optim.Optimizer,
    *,
    group: Group = SINGLE_PROCESS,
) -> Iterator[Step]:
    """Recorded on a GPU of one's own, else plain: others who share a minibatch wait in the middle of it."""
    step = plain_step(gradients, network, optimizer)
    if group.size > 1 or not next(network.parameters()).is_cuda:
        yield step
        return
    with recordable(optimizer):
        yield RecordedStep(step, CudaGraphs())
