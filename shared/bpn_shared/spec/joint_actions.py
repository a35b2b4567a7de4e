"""Actions of several dimensions as one number: a choice in each dimension, the last one counting fastest.

Frames, actions and decisions carry that number, and robots are told it, so that one dimension is no special case:
its choice is the action. Episodes have the choices, which is what a policy learns from.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt


def count(dims: Sequence[int]) -> int:
    """How many joint actions there are."""
    return math.prod(dims)


def joined(choices: Sequence[int], dims: Sequence[int]) -> int:
    """The number of an action.

    Args:
        choices: one of 0..n_d-1 for each dimension.
        dims: n_d.

    Raises:
        ValueError: a choice is outside its dimension's, or there are not as many as dimensions.
    """
    action = 0
    for d, (choice, choices_there) in enumerate(zip(choices, dims, strict=True)):
        if not 0 <= choice < choices_there:
            raise ValueError(f"choice {choice} of dimension {d} is outside 0..{choices_there - 1}")
        action = action * choices_there + choice
    return action


def parted(action: int, dims: Sequence[int]) -> tuple[int, ...]:
    """The choice in each dimension of an action's number.

    Raises:
        ValueError: there is no such action.
    """
    if not 0 <= action < count(dims):
        raise ValueError(f"action {action} is outside 0..{count(dims) - 1}")
    choices: list[int] = []
    for choices_there in reversed(dims):
        action, choice = divmod(action, choices_there)
        choices.append(choice)
    return tuple(reversed(choices))


def format_dims(dims: Sequence[int]) -> str:
    """What `parse_dims` reads."""
    return ",".join(map(str, dims))


def parse_dims(text: str) -> tuple[int, ...]:
    """Reads "7,7,3": choices of each of several dimensions; nothing, or a single number, is none.

    Raises:
        ValueError: it is no such list.
    """
    parts = [part.strip() for part in text.split(",")] if text.strip() else []
    for part in parts:
        if not (part.isascii() and part.isdigit() and len(part) <= 2 and int(part) >= 2):
            raise ValueError(
                f"{part!r} is no number of choices: a list of them, 2 or more for each dimension, such as 7,7,3"
            )
    return tuple(map(int, parts)) if len(parts) > 1 else ()


def all_parted(actions: npt.NDArray[np.integer], dims: Sequence[int]) -> npt.NDArray[np.int64]:
    """`parted` of many: int[T] to int64[T, D]."""
    rest = actions.astype(np.int64)
    choices = np.empty((len(rest), len(dims)), np.int64)
    for d in reversed(range(len(dims))):
        rest, choices[:, d] = np.divmod(rest, dims[d])
    return choices
