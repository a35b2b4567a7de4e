"""What P is fitted to: entry points of the group `bpn.targets`, which a run's algorithm names."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from bpn_learner.cvi import cvi_target, dqn_target
from bpn_shared import plugins


@dataclass(frozen=True, eq=False)
class TargetInputs:
    """The transitions of D, in their order, and what the policy before the update makes of them.

    Attributes:
        reward: r, float32[n].
        action: a, int64[n].
        P_s: P-(s, .), float32[n, |A|].
        P_next: P-(s', .), float32[n, |A|].
        done: s' is terminal and worth `terminal`, bool[n]; None: its P- counts like any other's.
        terminal: what no further reward is worth; 0 unless preferences are relative.
    """

    reward: Tensor
    action: Tensor
    P_s: Tensor
    P_next: Tensor
    done: Tensor | None = None
    terminal: float = 0.0


class TargetSettings(Protocol):
    """What of a run's configuration targets may depend on; `options` are the algorithm's own."""

    @property
    def alpha(self) -> float: ...

    @property
    def beta(self) -> float: ...

    @property
    def gamma(self) -> float: ...

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
    return cvi_target(
        data.reward, data.P_s, data.action, data.P_next,
        alpha=settings.alpha, beta=settings.beta, gamma=settings.gamma, done=data.done, terminal=data.terminal,
    )  # fmt: skip


def dqn(data: TargetInputs, settings: TargetSettings) -> Tensor:
    """The `TargetFunction` of BQN and DQN."""
    return dqn_target(
        data.reward, data.P_next, gamma=settings.gamma, done=data.done, terminal=data.terminal
    )
