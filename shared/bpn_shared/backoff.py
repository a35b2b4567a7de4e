"""Pauses between tries that grow, so that whoever is away is not stormed when it comes back."""

import random


class Backoff:
    """The pauses of one who tries again: each `factor` times the last one's length, and never equal to others'.

    Args:
        first_s: the first pause, seconds.
        most_s: what they grow to.
        jitter: the part of a pause that is left to chance: many who began together do not ask together.
    """

    def __init__(
        self, first_s: float = 0.1, most_s: float = 2.0, *, factor: float = 2.0, jitter: float = 0.5
    ) -> None:
        self._first_s, self._most_s = first_s, most_s
        self._factor, self._jitter = factor, jitter
        self._next_s = first_s

    def next_s(self) -> float:
        """How long to wait before the next try, seconds."""
        pause_s = self._next_s
        self._next_s = min(self._factor * pause_s, self._most_s)
        return pause_s * (1 - self._jitter * random.random())  # noqa: S311 - spreads, hides nothing

    def reset(self) -> None:
        """There was an answer: the next pause is a first one."""
        self._next_s = self._first_s
