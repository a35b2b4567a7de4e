"""Servos with play: their output follows the goal only where it has used the play up (the play operator)."""

from collections.abc import Mapping, Sequence

from bpn_shared.spec.disturbances import Range, drawn


class Backlash:
    """The play of a robot's servos in one episode.

    Args:
        levels: the task's disturbances; without backlash among them there is none.
        seed: the episode's.
        goal: where the servos stand, in the middle of their play.
    """

    def __init__(self, levels: Mapping[str, Range], seed: int, goal: Sequence[float]) -> None:
        self._half = drawn(levels, seed).get("backlash", 0.0) / 2
        self._output = list(goal)

    def output(self, goal: Sequence[float]) -> list[float]:
        """Where the servos' outputs go for a new goal: no further than the play makes them."""
        self._output = [
            min(max(was, to - self._half), to + self._half)
            for was, to in zip(self._output, goal, strict=True)
        ]
        return list(self._output)
