"""Episodes that are played to see how good a policy is, and that nothing is learned from."""

import threading
from collections import Counter
from collections.abc import Container

from bpn_shared.bnn.weights import Weights
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import (
    Assignment,
    EpisodeReceipt,
    Fault,
    FaultReceipt,
    NextEpisode,
)
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.config import Policy, RunConfig
from bpn_shared.spec.seeds import episode_seed

EVALUATION = 2**31
"""Trials have this or more in the place of the iteration, so that none is an episode of the training."""

_TRIES = 3
POLICIES: dict[str, tuple[Policy, float]] = {
    "greedy": ("epsilon_greedy", 0.0),
    "random": ("epsilon_greedy", 1.0),
    "softmax": ("softmax", 0.0),
}


class Everybody:
    """Contains every worker: whoever is gone comes back at its slot."""

    def __contains__(self, _worker: object) -> bool:
        return True


class Trials:
    """Some trials of one policy: handed out, taken, kept in memory. Its methods may be called from any thread.

    Args:
        weights: the only weights that are played.
        policy: one of `POLICIES`.
        iteration: what stands in its place in messages.
        stream: what stands in its place where seeds are made.
        alive: the edges that are alive; what others held is handed out again.

    Attributes:
        iteration: as given.
        over: set when all are played, or one cannot be.
        failure: why one cannot be; "" otherwise.
    """

    def __init__(
        self,
        config: RunConfig,
        weights: Weights,
        *,
        count: int,
        policy: str = "greedy",
        iteration: int = EVALUATION,
        stream: int = EVALUATION,
        alive: Container[str] | None = None,
    ) -> None:
        self._config, self._count = config, count
        self._attempt, self._version = weights.attempt, weights.version
        self._policy, self._epsilon = POLICIES[policy]
        self.iteration, self._stream = iteration, stream
        self._alive: Container[str] = Everybody() if alive is None else alive
        self._lock = threading.Lock()
        self._episodes: dict[int, Episode] = {}
        self._held: dict[int, tuple[int, str]] = {}  # slot: the trial that it plays, and its edge
        self._in_hand: dict[int, tuple[int, str]] = {}  # slot: what it has played and delivers
        self._told: Counter[tuple[int, str]] = Counter()
        self.over, self.failure = threading.Event(), ""

    @property
    def played(self) -> int:
        """How many trials are over."""
        with self._lock:
            return len(self._episodes)

    def episodes(self) -> list[Episode]:
        """Those that are over, in order of their trials."""
        with self._lock:
            return [self._episodes[trial] for trial in sorted(self._episodes)]

    def next(self, asked: NextEpisode) -> Assignment:
        """The trial that a slot shall play now."""
        slot = asked.slot
        with self._lock:
            self._in_hand.pop(slot, None)
            if asked.in_hand is not None and asked.in_hand[0] == self.iteration:
                self._in_hand[slot] = asked.in_hand[1], asked.worker
            trial = self._choose(slot)
            if trial is None:
                return Assignment(verdict="wait", reason="the other robots' trials")
            self._held[slot] = trial, asked.worker
        return Assignment(
            verdict="play",
            iteration=self.iteration,
            episode=trial,
            seed=episode_seed(self._config.seed, self._stream, trial),
            weights_attempt=self._attempt,
            weights_version=self._version,
            policy=self._policy,
            epsilon=self._epsilon,
        )

    def _choose(self, slot: int) -> int | None:
        nothing = None, ""
        (held, _), (in_hand, _) = self._held.get(slot, nothing), self._in_hand.get(slot, nothing)
        if held is not None and held not in self._episodes and held != in_hand:
            return held  # and has not in hand: its edge was restarted
        out = [*self._held.values(), *self._in_hand.values()]
        taken = {*self._episodes, *(trial for trial, edge in out if edge in self._alive)}
        return next((trial for trial in range(self._count) if trial not in taken), None)

    def receive(self, data: bytes) -> EpisodeReceipt:
        """Takes a delivered trial.

        Raises:
            MessageError: the bytes are no episode of the task.
        """
        episode = Episode.decode(data, self._config.task_spec)
        meta = episode.meta
        if meta.iteration != self.iteration or meta.episode >= self._count:
            raise MessageError(f"episode ({meta.iteration}, {meta.episode}) is none of the trials")
        with self._lock:
            known = meta.episode in self._episodes
            self._episodes.setdefault(meta.episode, episode)
            if len(self._episodes) == self._count:
                self.over.set()
        return EpisodeReceipt(verdict="duplicate" if known else "stored")

    def fault(self, fault: Fault) -> FaultReceipt:
        """A fault of an edge or a robot; the same one three times will be there the fourth time too."""
        with self._lock:
            told = fault.episode, fault.reason
            self._told[told] += 1
            if self._told[told] == _TRIES and fault.episode not in self._episodes:
                self.failure = f"trial {fault.episode} cannot be played: {fault.reason}"
                self.over.set()
        return FaultReceipt()
