"""The memory: which iterations' episodes are D."""

from collections import deque
from collections.abc import Sequence

from bpn_learner.transitions import EpisodeData


class ReplayMemory:
    """The newest data sets, one of each iteration, always whole.

    Args:
        iterations: how many, at most; of no consequence where transitions count.
        transitions: how many all of them have together, at most, but for the newest, which always stays; 0: any.
    """

    def __init__(self, iterations: int, transitions: int = 0) -> None:
        self._iterations, self._transitions = iterations, transitions
        self._sets: deque[list[EpisodeData]] = deque()

    @property
    def newest(self) -> list[EpisodeData]:
        """The last iteration's episodes."""
        return self._sets[-1]

    @property
    def episodes(self) -> list[EpisodeData]:
        """All of D, the oldest first."""
        return [episode for held in self._sets for episode in held]

    def add(self, episodes: list[EpisodeData]) -> None:
        """Makes an iteration's episodes the newest, and forgets the oldest that are too many."""
        self._sets.append(episodes)
        sizes = [sum(len(episode.actions) for episode in held) for held in self._sets]
        for _ in range(len(self._sets) - self.kept(sizes)):
            self._sets.popleft()

    def kept(self, sizes: Sequence[int]) -> int:
        """How many of the newest of these data sets would be held, each with so many transitions."""
        if not self._transitions:
            return min(len(sizes), self._iterations)
        total = kept = 0
        for size in reversed(sizes):
            total += size
            if kept and total > self._transitions:
                break
            kept += 1
        return kept
