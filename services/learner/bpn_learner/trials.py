"""Episodes that are played to see how good a policy is, and that nothing is learned from."""

import threading
from collections.abc import Container

from bpn_learner.lease import Lease
from bpn_learner.refusals import EpisodeRefusals
from bpn_shared.bnn.weights import Weights
from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.control import (
    MAX_REASON,
    Assignment,
    EpisodeReceipt,
    Fault,
    FaultReceipt,
    NextEpisode,
)
from bpn_shared.messages.episode import Episode, EpisodeMeta, decode_meta
from bpn_shared.spec.algorithms import EPSILON_GREEDY, SOFTMAX
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed

EVALUATION = 2**31
"""Trials have this or more in the place of the iteration, so that none is an episode of the training."""

POLICIES: dict[str, tuple[str, float]] = {
    "greedy": (EPSILON_GREEDY, 0.0),
    "random": (EPSILON_GREEDY, 1.0),
    "softmax": (SOFTMAX, 0.0),
}
"""Selection and epsilon; every edge has them, whatever a run's algorithm is."""


class Everybody:
    """Contains every worker: whoever is gone comes back at its slot."""

    def __contains__(self, _worker: object) -> bool:
        return True


class TrialLedger:
    """Some trials of one policy: handed out, taken, kept in memory. Its methods may be called from any thread.

    Args:
        weights: the only weights that are played.
        policy: one of `POLICIES`.
        iteration: what stands in its place in messages.
        stream: what stands in its place where seeds are made.
        alive: the edges that are alive; what others held, or one for too long, is handed out again.

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
        self._held: dict[int, tuple[int, Lease]] = {}  # by slot: the trial that it plays
        self._in_hand: dict[int, tuple[int, Lease]] = {}  # by slot: what it has played and delivers
        self._refusals = EpisodeRefusals()
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
        slot, lease = asked.slot, Lease.begin(asked, self._config)
        with self._lock:
            self._in_hand.pop(slot, None)
            if asked.in_hand is not None and asked.in_hand[0] == self.iteration:
                self._in_hand[slot] = asked.in_hand[1], lease
            trial = self._choose(slot)
            if trial is None:
                return Assignment(status="wait", reason="the other robots' trials")
            self._held[slot] = trial, lease
        return Assignment(
            status="play",
            iteration=self.iteration,
            episode=trial,
            seed=self._seed(trial),
            weights_attempt=self._attempt,
            weights_version=self._version,
            policy=self._policy,
            epsilon=self._epsilon,
        )

    def _seed(self, trial: int) -> int:
        return episode_seed(self._config.seed, self._stream, trial)

    def _choose(self, slot: int) -> int | None:
        held, in_hand = (
            place[slot][0] if slot in place else None for place in (self._held, self._in_hand)
        )
        if held is not None and held not in self._episodes and held != in_hand:
            return held  # and has not in hand: its edge was restarted
        out = [*self._held.values(), *self._in_hand.values()]
        taken = {*self._episodes, *(trial for trial, lease in out if lease.holds(self._alive))}
        return next((trial for trial in range(self._count) if trial not in taken), None)

    def receive(self, data: bytes) -> EpisodeReceipt:
        """Takes a delivered trial; what is none is refused for good, and played again.

        Raises:
            OtherVersionError: the edge is of another version.
            MessageError: the bytes are no episode.
        """
        try:
            episode = Episode.decode(data, self._config.task_spec)
        except OtherVersionError:
            raise
        except MessageError as error:
            meta, _ = decode_meta(data)  # raises, if it is not even known which one it is
            return self._refuse(meta, str(error))
        meta = episode.meta
        if (reason := self._why_other(meta)) is not None:
            return self._refuse(meta, reason)
        with self._lock:
            known = meta.episode in self._episodes
            self._episodes.setdefault(meta.episode, episode)
            if len(self._episodes) == self._count:
                self.over.set()
        return EpisodeReceipt(status="duplicate" if known else "stored")

    def _why_other(self, meta: EpisodeMeta) -> str | None:
        """What keeps an episode from being one of these trials, if anything does."""
        if meta.iteration != self.iteration or meta.episode >= self._count:
            return f"episode ({meta.iteration}, {meta.episode}) is none of the trials"
        if meta.seed != self._seed(meta.episode):
            return f"seed {meta.seed} is another evaluation's"
        if (meta.weights_attempt, meta.weights_version) != (self._attempt, self._version):
            return f"played with weights version {meta.weights_version} of attempt {meta.weights_attempt}"
        return None

    def _refuse(self, meta: EpisodeMeta, reason: str) -> EpisodeReceipt:
        if meta.iteration == self.iteration:
            self._count_refusal(meta.episode, reason)
        return EpisodeReceipt(status="refused", reason=reason[:MAX_REASON])

    def fault(self, fault: Fault) -> FaultReceipt:
        """Notes that a trial cannot be had; one of which that is told again and again ends them."""
        if fault.iteration == self.iteration:
            self._count_refusal(fault.episode, fault.reason)
        return FaultReceipt()

    def _count_refusal(self, trial: int, reason: str) -> None:
        with self._lock:
            if trial >= self._count or trial in self._episodes or self.over.is_set():
                return
            why = self._refusals.add(trial, reason)
            if why is not None:
                self.failure = f"trial {trial} cannot be played: {why}"
                self.over.set()
