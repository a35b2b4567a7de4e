"""What P is fitted to: entry points of the group `bpn.targets`, which a run's algorithm names."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from bpn_learner.cvi import cvi_gap, cvi_target, dqn_target
from bpn_learner.n_step import n_step
from bpn_shared import plugins


@dataclass(frozen=True, eq=False)
class TargetInputs:
    """The transitions of D, in their order, and what the policy before the update makes of them.

    Attributes:
        reward: r, float32[n].
        action: a, int64[n]; of several dimensions int64[n, D], the choice in each.
        P_s: P-(s, .), float32[n, |A|].
        P_next: P-(s', .), float32[n, |A|].
        done: s' is terminal and worth `terminal`, bool[n]; None: its P- counts like any other's.
        terminal: what no further reward is worth; 0 unless preferences are relative, which lack -terminal.
        steps_left: of each one's episode, itself counted, int64[n]; episodes are one behind the other.
        dims: choices of each dimension of the actions, whose preferences stand side by side; none: there is one.
    """

    reward: Tensor
    action: Tensor
    P_s: Tensor
    P_next: Tensor
    done: Tensor | None = None
    terminal: float = 0.0
    steps_left: Tensor | None = None
    dims: tuple[int, ...] = ()


class TargetSettings(Protocol):
    """What of a run's configuration targets may depend on; `options` are the algorithm's own."""

    @property
    def alpha(self) -> float: ...

    @property
    def beta(self) -> float: ...

    @property
    def gamma(self) -> float: ...

    @property
    def relative_targets(self) -> bool: ...

    @property
    def n_step(self) -> int: ...

    @property
    def gap_floor(self) -> float: ...

    @property
    def options(self) -> Mapping[str, Any]: ...


TargetFunction = Callable[[TargetInputs, TargetSettings], Tensor]
"""y, float32[n]: a pure function, for the same update may be done again, and must come to the same bits."""


def target_values(name: str, data: TargetInputs, settings: TargetSettings) -> Tensor:
    """Y of the installed targets of that name.

    Raises:
        PluginError: they are not installed here, broken, or give something else than float32[n].
    """
    plugin = plugins.find(plugins.TARGETS, name)
    y = plugin.call(data, settings)
    if not (isinstance(y, Tensor) and y.is_floating_point() and y.shape == data.reward.shape):
        found = f"{y.dtype}{list(y.shape)}" if isinstance(y, Tensor) else type(y).__name__
        raise plugin.broken(f"it gives {found}, not float32[{len(data.reward)}]")
    return y.detach()


def cvi(data: TargetInputs, settings: TargetSettings) -> Tensor:
    """The `TargetFunction` of BPN, CVI and DPP."""
    correction = None
    if settings.n_step > 1:
        gap, floored = cvi_gap(
            data.P_s, data.action, beta=settings.beta, floor=settings.gap_floor, dims=data.dims
        )
        correction = gap - settings.alpha * floored
    over = over_steps(data, settings, correction)
    return cvi_target(
        over.reward, data.P_s, data.action, over.P_next,
        alpha=settings.alpha, beta=settings.beta, gamma=over.discount, done=over.done, terminal=data.terminal,
        floor=settings.gap_floor, dims=data.dims,
    )  # fmt: skip


def dqn(data: TargetInputs, settings: TargetSettings) -> Tensor:
    """The `TargetFunction` of BQN and DQN."""
    over = over_steps(data, settings)
    return dqn_target(
        over.reward,
        over.P_next,
        gamma=over.discount,
        done=over.done,
        terminal=data.terminal,
        dims=data.dims,
    )


@dataclass(frozen=True, eq=False)
class OverSteps:
    """What a target adds up, and what it bootstraps from.

    Attributes:
        reward: of the steps, float32[n].
        P_next: P- of the last one's s', float32[n, |A|].
        done: whether that is terminal, bool[n]; None as in `TargetInputs`.
        discount: of that s', one or float32[n].
    """

    reward: Tensor
    P_next: Tensor
    done: Tensor | None
    discount: float | Tensor


def over_steps(
    data: TargetInputs, settings: TargetSettings, correction: Tensor | None = None
) -> OverSteps:
    """The data over `n_step` steps; with one step the data themselves.

    Preferences that lack c lack gamma^n c behind n steps, and n is smaller at an episode's end: what is more or
    less than gamma c is added to the rewards, so that sums of several lengths lack the same. Where no terminal
    state pins values, c is what they will lack, E[r] / (1 - gamma), from the beginning.

    Args:
        correction: see `n_step`, float32[n].

    Raises:
        ValueError: there are several steps, and the data do not say where episodes end.
    """
    if settings.n_step == 1:
        return OverSteps(data.reward, data.P_next, data.done, settings.gamma)
    if data.steps_left is None:
        raise ValueError("targets over several steps need steps_left")
    gamma = settings.gamma
    steps = n_step(data.reward, data.steps_left, settings.n_step, gamma, correction)
    c = -data.terminal
    if settings.relative_targets and data.done is None:
        c = float(data.reward.mean()) / (1 - gamma)
    return OverSteps(
        reward=steps.reward + (steps.discount - gamma) * c,
        P_next=data.P_next[steps.last],
        done=None if data.done is None else data.done[steps.last],
        discount=steps.discount,
    )
