"""Stands where a run's learner stands, and lets its robots play trials instead of training."""

from uuid import UUID

from bpn_learner.trials import EVALUATION, TrialLedger
from bpn_shared.bnn.weights import Weights
from bpn_shared.bus import keys
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus
from bpn_shared.bus.weights import WeightsPublisher
from bpn_shared.counters import Counters
from bpn_shared.messages.control import Fault, NextEpisode
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.config_file import encode_config
from bpn_shared.spec.config import RunConfig

__all__ = ["EVALUATION", "TrialHost"]


class TrialHost:
    """Answers edges and robots of one run; its handlers run on threads of the bus.

    Args:
        config: what the workers are told.
        weights: the only weights that are played.
        count: trials.
        policy: "greedy", "softmax" or "random".

    Attributes:
        over: set when all trials are played, or one cannot be.
    """

    def __init__(
        self, bus: Bus, run: UUID, config: RunConfig, weights: Weights, *, count: int, policy: str
    ) -> None:
        self._config = config
        self._trials = TrialLedger(config, weights, count=count, policy=policy)
        self.over = self._trials.over
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
    def failure(self) -> str:
        """Why a trial cannot be played; "" otherwise."""
        return self._trials.failure

    @property
    def trial_s(self) -> float:
        """How long a trial takes in realtime pacing, at most."""
        return self._config.steps * self._config.task_spec.control_period_s

    @property
    def played(self) -> int:
        """How many trials are over."""
        return self._trials.played

    def episodes(self) -> list[Episode]:
        """Those that are over, in order of their trials."""
        return self._trials.episodes()

    def _tell_config(self, _body: bytes) -> bytes:
        return encode_config(self._config)

    def _hand_out(self, body: bytes) -> bytes:
        return self._trials.next(NextEpisode.decode(body)).encode()

    def _receive(self, body: bytes) -> bytes:
        return self._trials.receive(body).encode()

    def _hear(self, body: bytes) -> bytes:
        return self._trials.fault(Fault.decode(body)).encode()
