"""A Gymnasium environment's actions as choices among few: one list of them for every dimension."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiBinary, MultiDiscrete

from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import MAX_ACTIONS


class ActionChoices(NamedTuple):
    """What can be chosen, and the action that a choice is.

    Attributes:
        dims: how many choices each dimension has, in the order of the space's elements.
        action: of one choice, from 0 on, for each dimension; an element of the space.
    """

    dims: tuple[int, ...]
    action: Callable[[Sequence[int]], Any]


def choices_of(space: Any, task: str, bins: int) -> ActionChoices:
    """The choices of an action space.

    Args:
        bins: values of a continuous dimension, evenly spaced from its lowest to its highest; 0: none given.

    Raises:
        ConfigError: nothing can be chosen there, or `bins` is missing or of no use.
    """
    if bins and not isinstance(space, Box):
        raise ConfigError(
            f"{task} has actions {space}, which are discrete already: leave action_bins out"
        )
    if isinstance(space, Discrete):
        kind = space.dtype.type
        found = ActionChoices((int(space.n),), lambda chosen: kind(space.start + chosen[0]))
    elif isinstance(space, MultiDiscrete):
        found = _elements(space, [np.arange(n) for n in space.nvec.flat], space.start)
    elif isinstance(space, MultiBinary):
        found = _elements(space, [np.arange(2)] * math.prod(space.shape), np.zeros(space.shape))
    elif isinstance(space, Box):
        found = _elements(space, _binned(space, task, bins), np.zeros(space.shape))
    else:
        raise ConfigError(f"{task} has actions {space}: only discrete ones can be learned")
    for count in found.dims:
        if not 2 <= count <= MAX_ACTIONS:
            raise ConfigError(f"{task} has {count} actions, a policy has 2..{MAX_ACTIONS}")
    return found


def one_list(choices: ActionChoices, task: str) -> int:
    """|A| of a policy that has one list of actions, as all have that can be learned today.

    Raises:
        ConfigError: the environment wants a choice in each of several dimensions.
    """
    if len(choices.dims) != 1:
        shown = " x ".join(map(str, choices.dims[:8])) + (" x ..." if len(choices.dims) > 8 else "")
        raise ConfigError(
            f"{task} has actions of {len(choices.dims)} dimensions ({shown} choices), and a policy chooses in "
            "one: ask for a discrete mode with env_kwargs if it has one, or wrap it in one with env_wrappers"
        )
    return choices.dims[0]


def _elements(space: Any, values: list[Any], start: Any) -> ActionChoices:
    """Choices for the elements of an array, each from values of its own."""

    def action(chosen: Sequence[int]) -> Any:
        flat = [own[choice] for own, choice in zip(values, chosen, strict=True)]
        return (np.reshape(flat, space.shape) + start).astype(space.dtype)

    return ActionChoices(tuple(map(len, values)), action)


def _binned(space: Box, task: str, bins: int) -> list[Any]:
    if not bins:
        raise ConfigError(
            f"{task} has actions {space}: only discrete ones can be learned; with action_bins, 5 say, each is "
            "chosen from so many values"
        )
    if not space.is_bounded():
        raise ConfigError(
            f"{task} has actions {space}, whose range has no end that action_bins could reach: wrap it with "
            "env_wrappers"
        )
    shares = np.linspace(0.0, 1.0, bins) if bins > 1 else np.zeros(1)
    ranges = zip(space.low.flat, space.high.flat, strict=True)
    return [_spaced(low, high, shares, space.dtype) for low, high in ranges]


def _spaced(low: Any, high: Any, shares: Any, dtype: Any) -> Any:
    values = (
        float(low) * (1.0 - shares) + float(high) * shares
    )  # high - low may be beyond all floats
    if np.issubdtype(dtype, np.integer):
        return np.unique(np.rint(values).astype(dtype))
    return np.clip(values, low, high)
