"""Stands where a run's learner stands, and lets its robots play trials instead of training."""

import threading
from collections import Counter
from uuid import UUID

from bpn_shared.bnn.weights import Weights
from bpn_shared.bus import keys
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus
from bpn_shared.bus.weights import WeightsPublisher
from bpn_shared.counters import Counters
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
"""Stands where training has the iteration, so that no trial is an episode of the training."""

_TRIES = 3
_POLICIES: dict[str, tuple[Policy, float]] = {
    "greedy": ("epsilon_greedy", 0.0),
    "random": ("epsilon_greedy", 1.0),
    "softmax": ("softmax", 0.0),
}


class TrialHost:
    """Answers edges and robots of one run; its handlers run on threads of the bus.

    Args:
        config: what the workers are told.
        weights: the only weights that are played.
        count: trials.
        policy: "greedy", "softmax" or "random".

    Attributes:
        over: set when all trials are played, or one cannot be.
        failure: why one cannot be; "" otherwise.
    """

    def __init__(
        self, bus: Bus, run: UUID, config: RunConfig, weights: Weights, *, count: int, policy: str
    ) -> None:
        self._config, self._playing, self._count = config, weights, count
        self._policy, self._epsilon = _POLICIES[policy]
        self._lock = threading.Lock()
        self._episodes: dict[int, Episode] = {}
        self._held: dict[int, int] = {}  # slot: the trial that it plays
        self._in_hand: dict[
            int, int
        ] = {}  # slot: the trial that it has played, and delivers meanwhile
        self._told: Counter[tuple[int, str]] = Counter()
        self.over, self.failure = threading.Event(), ""
        counters = Counters()
        self._weights = WeightsPublisher(bus, run)
        self._weights.publish(weights)
        self._responders = [
            Responder(bus, keys.config(run), self._tell_config, counters),
            Responder(bus, keys.next_episode(run), self._hand_out, counters),
            Responder(bus, keys.episode(run), self._receive, counters),
            Responder(bus, keys.fault(run), self._hear, counters),
        ]

    @property
    def trial_s(self) -> float:
        """How long a trial takes in realtime pacing, at most."""
        return self._config.steps * self._config.task_spec.control_period_s

    @property
    def played(self) -> int:
        """How many trials are over."""
        with self._lock:
            return len(self._episodes)

    def episodes(self) -> list[Episode]:
        """Those that are over, in order of their trials."""
        with self._lock:
            return [self._episodes[trial] for trial in sorted(self._episodes)]

    def _tell_config(self, _body: bytes) -> bytes:
        return self._config.model_dump_json().encode()

    def _hand_out(self, body: bytes) -> bytes:
        asked = NextEpisode.decode(body)
        slot = asked.slot
        with self._lock:
            self._in_hand.pop(slot, None)
            if asked.in_hand is not None:
                self._in_hand[slot] = asked.in_hand[1]
            trial = self._choose(slot)
            if trial is None:
                return Assignment(verdict="wait", reason="the other robots' trials").encode()
            self._held[slot] = trial
        return Assignment(
            verdict="play",
            iteration=EVALUATION,
            episode=trial,
            seed=episode_seed(self._config.seed, EVALUATION, trial),
            weights_attempt=self._playing.attempt,
            weights_version=self._playing.version,
            policy=self._policy,
            epsilon=self._epsilon,
        ).encode()

    def _choose(self, slot: int) -> int | None:
        held = self._held.get(slot)
        if held is not None and held not in self._episodes and held != self._in_hand.get(slot):
            return held  # and has not in hand: its edge was restarted
        taken = {*self._episodes, *self._held.values(), *self._in_hand.values()}
        return next((trial for trial in range(self._count) if trial not in taken), None)

    def _hear(self, body: bytes) -> bytes:
        """A fault of an edge or a robot; the same one three times will be there the fourth time too."""
        fault = Fault.decode(body)
        with self._lock:
            told = fault.episode, fault.reason
            self._told[told] += 1
            if self._told[told] == _TRIES and fault.episode not in self._episodes:
                self.failure = f"trial {fault.episode} cannot be played: {fault.reason}"
                self.over.set()
        return FaultReceipt().encode()

    def _receive(self, body: bytes) -> bytes:
        episode = Episode.decode(body, self._config.task_spec)
        with self._lock:
            known = episode.meta.episode in self._episodes
            self._episodes.setdefault(episode.meta.episode, episode)
            if len(self._episodes) == self._count:
                self.over.set()
        return EpisodeReceipt(verdict="duplicate" if known else "stored").encode()
