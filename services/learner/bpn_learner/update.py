"""Algorithm 1's PolicyUpdate: from theta and D to the next theta."""

import math
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from bpn_learner.cvi import NO_FLOOR, outputs_taken
from bpn_learner.gathering import RegressionBatch, gathered_gradients
from bpn_learner.group import SINGLE_PROCESS, Group
from bpn_learner.networks import PNetwork
from bpn_learner.policy_metrics import agreement, entropy
from bpn_learner.steps import best_step
from bpn_learner.targets import TargetInputs, target_values
from bpn_learner.transitions import Transitions
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.sections import Backend

EVALUATION_BATCH = 256
LOOKED_AT = 256
"""Transitions whose greedy action is compared before and after an update."""


_STOP_EVERY = 64
"""Minibatches between two looks at whether to stop: an epoch over the data of many robots takes long."""


class UpdateStopped(Exception):  # noqa: N818
    """`stop` asked for an end; the network is half trained and must be given up."""


class DivergenceError(ArithmeticError):
    """The loss is no longer finite."""


@dataclass(frozen=True, slots=True)
class UpdateConfig:
    """Table I of the paper, and what it leaves open.

    Attributes:
        epochs: C.
        batch_size: B, at least 2.
        target: the targets' plug-in, such as "cvi" (BPN, CVI, DPP) or "dqn" (BQN, DQN).
        options: the algorithm's own.
        bootstrap_terminals: from terminal states too, as Algorithm 1 as printed does from every s'.
        relative_targets: y less its mean over D, see `targets`.
        n_step: steps that a target adds up.
        gap_floor: of CVI's gap, see `cvi_target`.
        max_updates: optimizer steps at most; 0: C epochs.
        learning_rate_share: of the optimizer's learning rate, in this update's first epoch.
        lr_update_final_factor: of that, in the last epoch; in between it falls along a cosine.
        backend: what computes the minibatches' gradients, see `minibatch_gradients`.
    """

    alpha: float = 0.95
    beta: float = 1.0
    gamma: float = 0.99
    epochs: int = 50
    batch_size: int = 32
    target: str = "cvi"
    options: Mapping[str, Any] = field(default_factory=dict)
    bootstrap_terminals: bool = True
    relative_targets: bool = False
    n_step: int = 1
    gap_floor: float = NO_FLOOR
    max_updates: int = 0
    learning_rate_share: float = 1.0
    lr_update_final_factor: float = 1.0
    backend: Backend = "native"

    @classmethod
    def of_iteration(cls, config: RunConfig, iteration: int) -> Self:
        """What a run's configuration asks for in an iteration."""
        return cls(
            alpha=config.alpha,
            beta=config.beta_of(iteration),
            gamma=config.gamma,
            epochs=config.epochs,
            batch_size=config.batch_size,
            target=config.algorithm_spec.targets,
            options=config.own_options,
            bootstrap_terminals=config.bootstrap_terminals,
            relative_targets=config.relative_targets,
            n_step=config.n_step,
            gap_floor=config.gap_floor or NO_FLOOR,
            max_updates=config.max_updates,
            learning_rate_share=config.learning_rate_share(iteration),
            lr_update_final_factor=config.lr_update_final_factor,
            backend=config.backend,
        )


Gather = Callable[[RegressionBatch], AbstractContextManager[Group]]
"""Finds the learners that share an update, and tells them what to fit."""


@dataclass(frozen=True, slots=True)
class UpdateReport:
    """What an update did.

    Attributes:
        loss_first, loss_last: mean loss of the first and of the last epoch.
        max_preference: largest |P-(s, .)| over D.
        max_target: largest |y|.
        scale: lambda afterwards.
        entropy: mean over D of the policy softmax(beta P-), in nats.
        agreement: share of D, of at most `LOOKED_AT` transitions, in which the greedy action is as before.
        saturation: share of targets with |y| > lambda N, which the network cannot express.
        updates: optimizer steps.
        seconds: duration.
    """

    loss_first: float
    loss_last: float
    max_preference: float
    max_target: float
    scale: float
    entropy: float
    agreement: float
    saturation: float
    updates: int
    seconds: float


def make_optimizer(network: PNetwork, learning_rate: float) -> torch.optim.Adam:
    """Adam, as the network asks for it."""
    optimizer = torch.optim.Adam(
        network.parameter_groups(learning_rate), lr=learning_rate, fused=True
    )
    for group in optimizer.param_groups:
        group["initial_lr"] = group["lr"]  # what `annealing` is a factor of
    return optimizer


def policy_update(
    network: PNetwork,
    optimizer: torch.optim.Optimizer,
    transitions: Transitions,
    settings: UpdateConfig,
    rng: np.random.Generator,
    *,
    again: Transitions | None = None,
    gather: Gather = lambda _: nullcontext(SINGLE_PROCESS),
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> UpdateReport:
    """Trains the network on D and leaves it in evaluation mode, ready to fold.

    A binarized network's batch norm is estimated anew over D and `again` at the end. With one thread, equal inputs
    give equal bits.

    Args:
        rng: shuffles D, once per epoch.
        again: the same transitions with other pictures; P is fitted to D's targets there too.
        gather: the learners that share the minibatches; by default there are no others.
        progress: called with (epochs done, epochs) after each.
        stop: asked before each epoch, and in long ones some times a second.

    Raises:
        UpdateStopped: `stop` returned True.
        GroupLostError: one of the learners was lost; the network is half trained and must be given up.
        DivergenceError: the loss of an epoch is not finite.
        ValueError: D holds fewer than 2 transitions.
    """
    started = time.perf_counter()
    device = next(network.parameters()).device
    transitions = transitions.to(device)
    P_target, P_next = target_preferences(network, transitions)
    dims, actions = network.spec.action_dims, transitions.actions
    y, offset = targets(transitions, P_target, P_next, settings, float(network.offset), dims=dims)
    taken = outputs_taken(actions, dims) if len(dims) > 1 else actions
    regression = RegressionBatch(transitions.frames, transitions.observations, taken, y)
    if again is not None:
        regression = regression.with_pictures(again.to(device))
    with gather(regression) as group:
        losses = fit(
            network, optimizer, regression, settings, rng, group=group, progress=progress, stop=stop
        )
    network.eval()
    network.offset.fill_(offset)

    network.finish_update(lambda: regression.parts(EVALUATION_BATCH))
    return UpdateReport(
        loss_first=losses[0],
        loss_last=losses[-1],
        max_preference=float(P_target.abs().max()),
        max_target=float(y.abs().max()),
        scale=float(network.scale().detach()),
        entropy=entropy(P_target, settings.beta, dims),
        agreement=_agreement(network, transitions, P_target),
        saturation=float((y.abs() > network.max_preference()).float().mean()),
        updates=updates_of(settings, len(regression.y)),
        seconds=time.perf_counter() - started,
    )


def _agreement(network: PNetwork, transitions: Transitions, P_target: Tensor) -> float:
    """Of the newest transitions: as many as cost little beside the update."""
    newest = transitions.observations[-LOOKED_AT:]
    after = preferences(network, transitions.parts(newest, EVALUATION_BATCH))
    return agreement(P_target[-LOOKED_AT:], after, network.spec.action_dims)


def fit(
    network: PNetwork,
    optimizer: torch.optim.Optimizer,
    regression: RegressionBatch,
    settings: UpdateConfig,
    rng: np.random.Generator,
    *,
    group: Group = SINGLE_PROCESS,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> list[float]:
    """The epochs of an update, on every member of a group alike; otherwise as `policy_update`.

    Returns:
        The mean loss of every epoch.
    """
    B, size = settings.batch_size, len(regression.actions)
    minibatches = minibatches_per_epoch(size, B)
    gradients = gathered_gradients(settings.backend, network, regression, B, group=group)
    losses: list[float] = []

    updates = updates_of(settings, size)
    epochs = -(-updates // minibatches)
    network.train()
    with best_step(gradients, network, optimizer, group=group) as step:
        for epoch in range(epochs):
            set_learning_rate(optimizer, annealing(epoch, settings))
            order = torch.from_numpy(rng.permutation(size)).to(regression.y.device)
            total = torch.zeros((), device=regression.y.device)
            steps = min(minibatches, updates - epoch * minibatches)
            for k in range(steps):
                if stop is not None and k % _STOP_EVERY == 0 and stop():
                    raise UpdateStopped(f"stopped after {epoch} of {epochs} epochs")
                if settings.max_updates:  # may end within an epoch: annealed from step to step
                    done = epoch * minibatches + k
                    set_learning_rate(optimizer, annealed(done, updates, settings))
                total += step(order[B * k : B * (k + 1)])
            losses.append(_finite(float(total) / steps, network))
            if progress is not None:
                progress(epoch + 1, epochs)
    return losses


def updates_of(settings: UpdateConfig, size: int) -> int:
    """Optimizer steps of an update over D of that size."""
    updates = settings.epochs * minibatches_per_epoch(size, settings.batch_size)
    return min(updates, settings.max_updates) if settings.max_updates else updates


def annealing(epoch: int, settings: UpdateConfig) -> float:
    """The learning rate's factor in an epoch, see `annealed`."""
    return annealed(epoch, settings.epochs, settings)


def annealed(done: int, count: int, settings: UpdateConfig) -> float:
    """The learning rate's factor in one of `count` parts: a cosine from `learning_rate_share` down.

    Binary weights keep flipping as long as the rate is high. What the last flips leave is the policy that
    the robots run, so they have to become few before an update ends.
    """
    progress = done / max(1, count - 1)
    final = settings.lr_update_final_factor
    cosine = final + (1 - final) * (1 + math.cos(math.pi * progress)) / 2
    return settings.learning_rate_share * cosine


def set_learning_rate(optimizer: torch.optim.Optimizer, factor: float) -> None:
    """Sets every group's rate to that factor of what `make_optimizer` gave it."""
    for group in optimizer.param_groups:
        rate = factor * group["initial_lr"]
        if isinstance(group["lr"], Tensor):  # of a recorded step, which reads it where it is
            group["lr"].fill_(rate)
        else:
            group["lr"] = rate


def minibatches_per_epoch(size: int, batch: int) -> int:
    """round(|D| / B), halves down, at least 1: no minibatch has a single transition.

    Raises:
        ValueError: size is below 2, too few for batch statistics.
    """
    if size < 2:
        raise ValueError(f"D holds {size} transitions, a policy update needs at least 2")
    return max(1, (2 * size + batch - 1) // (2 * batch))


def target_preferences(network: PNetwork, transitions: Transitions) -> tuple[Tensor, Tensor]:
    """P-(s, .) and P-(s', .) of all of D, with theta- = theta as it is now.

    Most s' are the s of the next transition: every observation is evaluated once.
    """
    both = torch.cat([transitions.observations, transitions.next_observations])
    stacks, where = torch.unique(both, dim=0, return_inverse=True)
    P = preferences(network, transitions.parts(stacks, EVALUATION_BATCH))
    P_target, P_next = torch.split(P[where], len(transitions))
    return P_target, P_next


@torch.no_grad()
def preferences(network: PNetwork, observations: Iterable[Tensor]) -> Tensor:
    """P(s, .) of the evaluated network: uint8[n, C, rows, columns] each to float32[all n, |A|]."""
    network.eval()
    return torch.cat([network(part.float()) for part in observations])


def targets(
    transitions: Transitions,
    P_target: Tensor,
    P_next: Tensor,
    settings: UpdateConfig,
    offset: float = 0.0,
    *,
    dims: tuple[int, ...] = (),
) -> tuple[Tensor, float]:
    """Target y of every transition in D from P-(s, .) and P-(s', .), and what the next P leaves out.

    With `relative_targets` the network learns y less its mean over D, as in relative value iteration (White,
    1963), and the mean becomes the offset c that all its preferences lack. Added to all of P-, c only adds gamma c
    to CVI's y and DQN's (targets of one's own have to see to that), so no policy changes. What changes is that the
    values' common offset, which a reward of one sign lets grow by about E[r] every iteration, need not be
    expressed by a network that has no bias and +-N steps of lambda for offset and differences together. Beside
    relative values a terminal's 0 is -c.

    Args:
        offset: c of P-.
        dims: choices of each dimension of the actions; none: there is one.

    Returns:
        y: float32[n].
        offset: c of the network that learns y; 0 without `relative_targets`.
    """
    done = transitions.done if not settings.bootstrap_terminals else None
    reward, gamma = transitions.rewards, settings.gamma
    data = TargetInputs(
        reward, transitions.actions, P_target, P_next, done, -offset, transitions.steps_left, dims
    )
    y = target_values(settings.target, data, settings)
    if not settings.relative_targets:
        return y, 0.0
    mean = y.mean()
    return y - mean, gamma * offset + float(mean)


def _finite(loss: float, network: PNetwork) -> float:
    if not np.isfinite(loss):
        raise DivergenceError(
            f"loss = {loss} at lambda = {float(network.scale().detach()):g}: lower the learning rate or the "
            "reward scale"
        )
    return loss
