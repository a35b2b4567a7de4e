"""Refused episodes, counted: what seed and weights determine comes out the same at the next try."""

from dataclasses import dataclass

SAME_REASON = 3
ANY_REASON = 20


class EpisodeImpossibleError(RuntimeError):
    """An episode cannot be had, whoever plays it; the message says which and why."""


@dataclass(slots=True)
class _Tally:
    reason: str = ""
    in_a_row: int = 0
    in_all: int = 0


class EpisodeRefusals:
    """Of one iteration's episodes, or one evaluation's: how often each was refused, and why."""

    def __init__(self) -> None:
        self._tallies: dict[int, _Tally] = {}

    def add(self, episode: int, reason: str) -> str | None:
        """Counts a refusal; returns what has come of all of them once another try makes no sense."""
        tally = self._tallies.setdefault(episode, _Tally())
        tally.in_a_row = tally.in_a_row + 1 if reason == tally.reason else 1
        tally.in_all += 1
        tally.reason = reason
        if tally.in_a_row < SAME_REASON and tally.in_all < ANY_REASON:
            return None
        times = f"{tally.in_a_row} times in a row"
        if tally.in_a_row < SAME_REASON:
            times = f"the last of {tally.in_all} refusals"
        return f"{reason} ({times})"
