"""A Gymnasium environment's actions as choices among few: one list of them for every dimension."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiBinary, MultiDiscrete

from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import MAX_ACTIONS

BINS = 3
"""Of a continuous dimension, where nobody says how many: its lowest, middle and highest value."""


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
        bins: values of a continuous dimension, evenly spaced from its lowest to its highest; 0: `BINS`.

    Raises:
        ConfigError: nothing can be chosen there, too much can, or `bins` is of no use.
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
        found = _elements(space, _binned(space, task, bins or BINS), np.zeros(space.shape))
    else:
        raise ConfigError(
            f"{task} has actions {space}: Discrete, MultiDiscrete, MultiBinary and Box can be learned"
        )
    for count in found.dims:
        if not 2 <= count <= MAX_ACTIONS:
            raise ConfigError(f"{task} has {count} actions, a policy has 2..{MAX_ACTIONS}")
    if sum(found.dims) > MAX_ACTIONS:
        shown = " + ".join(map(str, found.dims[:8])) + (" + ..." if len(found.dims) > 8 else "")
        remedy = (
            "choose fewer action_bins" if isinstance(space, Box) else "wrap it with env_wrappers"
        )
        raise ConfigError(
            f"{task} has actions of {len(found.dims)} dimensions with {sum(found.dims)} choices together "
            f"({shown}), a policy has at most {MAX_ACTIONS}: {remedy}, or ask for a smaller mode with env_kwargs "
            "if it has one"
        )
    return found


def _elements(space: Any, values: list[Any], start: Any) -> ActionChoices:
    """Choices for the elements of an array, each from values of its own."""

    def action(chosen: Sequence[int]) -> Any:
        flat = [own[choice] for own, choice in zip(values, chosen, strict=True)]
        return (np.reshape(flat, space.shape) + start).astype(space.dtype)

    return ActionChoices(tuple(map(len, values)), action)


def _binned(space: Box, task: str, bins: int) -> list[Any]:
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
