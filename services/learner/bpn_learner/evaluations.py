"""Evaluations during training: between two iterations, edges are given trials in place of episodes."""

import threading
import time
from collections.abc import Callable, Container

from bpn_learner.callbacks import EvaluationEnd
from bpn_learner.ledger import PROVE_S
from bpn_learner.reward import episode_rewards
from bpn_learner.trials import EVALUATION, TrialLedger
from bpn_shared.bnn.weights import Weights
from bpn_shared.messages.control import (
    Assignment,
    EpisodeReceipt,
    Fault,
    FaultReceipt,
    NextEpisode,
)
from bpn_shared.messages.episode import decode_meta
from bpn_shared.runs.success import success_of
from bpn_shared.spec.config import RunConfig
from bpn_shared.waiting import WaitStatus

STREAM = 2**32 - 1
"""Stands where seeds have the iteration: neither the training has it, nor `bpn eval`."""


class Evaluations:
    """At most one evaluation at a time. `play` belongs to the thread that trains, all else to any.

    Args:
        prove: raises if the run is another learner's now, whom edges shall ask.
    """

    def __init__(
        self,
        config: RunConfig,
        alive: Container[str],
        waiting: WaitStatus,
        *,
        prove: Callable[[], object],
    ) -> None:
        self._config, self._alive, self._waiting = config, alive, waiting
        self._prove = prove
        self._now: TrialLedger | None = None

    def play(
        self, iteration: int, weights: Weights, episodes: int, stop: threading.Event
    ) -> EvaluationEnd | None:
        """Waits for greedy episodes with the weights; None if stopped before.

        Raises:
            RuntimeError: one of them cannot be played.
            InputError: the rewards of one cannot be told.
            OwnershipLostError: another learner has taken the run over.
        """
        trials = TrialLedger(
            self._config,
            weights,
            count=episodes,
            iteration=EVALUATION + weights.version,
            stream=STREAM,
            alive=self._alive,
        )
        self._now = trials
        try:
            self._waiting.set(f"{episodes} episodes that evaluate iteration {iteration}")
            prove_at_s = time.monotonic() + PROVE_S
            while not trials.over.wait(0.2):  # bounded, so that `stop` is seen
                if stop.is_set():
                    return None
                if time.monotonic() > prove_at_s:
                    self._prove()
                    prove_at_s = time.monotonic() + PROVE_S
        finally:
            self._now = None
            self._waiting.done()
        if trials.failure:
            raise RuntimeError(trials.failure)
        played, task = trials.episodes(), self._config.task_spec
        scored = [(one.meta, episode_rewards(task, one)) for one in played]
        return EvaluationEnd(
            iteration,
            weights.version,
            tuple(float(rewards.sum()) for _, rewards in scored),
            tuple(success_of(task, meta, rewards) for meta, rewards in scored),
        )

    def next(self, asked: NextEpisode) -> Assignment | None:
        """A trial, while an evaluation goes on; None: there is none."""
        trials = self._now
        return None if trials is None else trials.next(asked)

    def receive(self, data: bytes) -> EpisodeReceipt | None:
        """Takes a trial, of which a late one is not wanted any more; None: it is an episode of the training.

        Raises:
            MessageError: the bytes are no episode.
        """
        meta, _ = decode_meta(data)
        if meta.iteration < EVALUATION:
            return None
        trials = self._now
        if trials is None or meta.iteration != trials.iteration:
            return EpisodeReceipt(status="duplicate")
        return trials.receive(data)

    def fault(self, fault: Fault) -> FaultReceipt | None:
        """Notes that a trial cannot be had; None: it is about an episode of the training."""
        if fault.iteration < EVALUATION:
            return None
        trials = self._now
        return trials.fault(fault) if trials else FaultReceipt()
