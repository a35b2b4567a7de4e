"""Algorithm 1 over the bus: collect, learn, publish, checkpoint, for I iterations."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from bpn_learner.augmentation import seen_again
from bpn_learner.callbacks import CollectionEnd, EvaluationEnd
from bpn_learner.callbacks.calling import Callbacks
from bpn_learner.checkpoint import encode_checkpoint
from bpn_learner.episodes import Scored, load_episodes
from bpn_learner.evaluations import Evaluations
from bpn_learner.gathering import RegressionBatch
from bpn_learner.group import SINGLE_PROCESS, Group, GroupLostError
from bpn_learner.handout import broadcast_state
from bpn_learner.history import History
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.rendezvous import Rendezvous
from bpn_learner.replay import ReplayMemory
from bpn_learner.reward_scale import RewardScale
from bpn_learner.storage import StorageStopped, insist
from bpn_learner.transitions import EpisodeData, Transitions, data_of
from bpn_learner.update import (
    UpdateConfig,
    UpdateReport,
    UpdateStopped,
    policy_update,
)
from bpn_shared.bnn.weights import Weights
from bpn_shared.counters import Counters
from bpn_shared.runs.ownership import Ownership
from bpn_shared.runs.success import share, success_of
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.disturbances import parse
from bpn_shared.spec.seeds import shuffle_generator
from bpn_shared.waiting import WaitStatus

log = logging.getLogger(__name__)

GIVE_UP_AFTER = 8
"""Updates of one iteration in a row that were given up because a learner was lost."""

Report = Callable[[int, Mapping[str, float]], None]
"""Publishes live values (name to value) of an iteration."""


class Training:
    """One attempt at a run, from where its checkpoint stands.

    Args:
        owner: writes into the run folder; its attempt is stamped on the weights, so that edges prefer them to an
            earlier learner's.
        publish: sends weights to the edges.
        report: publishes live progress.
        rendezvous: gathers the other learners for every update; None: there are none.
        stop: ends the training as soon as possible; nothing is lost by it.
        evaluations: plays what callbacks ask for; None: there is nobody to.
        counters: `callbacks_failed` is counted here.

    Attributes:
        ended_early: why the run finished before its last iteration; "": it did not.
    """

    def __init__(
        self,
        config: RunConfig,
        owner: Ownership,
        ledger: EpisodeLedger,
        *,
        publish: Callable[[Weights], None],
        report: Report,
        rendezvous: Rendezvous | None,
        waiting: WaitStatus,
        stop: threading.Event,
        evaluations: Evaluations | None = None,
        counters: Counters | None = None,
    ) -> None:
        self._config, self._owner, self._ledger = config, owner, ledger
        self._publish, self._report = publish, report
        self._waiting, self._stop = waiting, stop
        self._rendezvous, self._exchange_s = rendezvous, 0.0
        self._history = History(config, owner.folder)
        self._network, self._optimizer, self._done = self._history.load_policy()
        self._reward_scale = RewardScale(config, self._history.reward_scale(self._done))
        self._evaluations, self._counters = evaluations, counters or Counters()
        self.ended_early = ""
        self._memory = ReplayMemory(config.replay_iterations, config.replay_transitions)  # D

    def run(self) -> bool:
        """Trains to the last iteration.

        Returns:
            False if `stop` ended it before.

        Raises:
            CheckpointError: the run folder's checkpoint is unusable.
            ConfigError: a callback is not installed, or cannot be made.
            DataError: data of an iteration that is done are lost, or others than they were.
            DivergenceError: the loss is no longer finite.
            EpisodeImpossibleError: an episode cannot be had.
            GroupLostError: other learners were lost in every one of many tries.
            OwnershipLostError: another learner has taken the run over.
            StorageError: the disk takes nothing, for long.
        """
        try:
            return self._train()
        except (UpdateStopped, StorageStopped):
            return False

    def _train(self) -> bool:
        self._restore()
        callbacks = Callbacks(
            self._config, self._owner, self._counters, first=self._done, play=self._evaluate
        )
        finished = False
        try:
            self.ended_early = self._iterate(callbacks)
            finished = True
        finally:
            callbacks.run_end(finished=finished, reason=self.ended_early)
        return finished

    def _iterate(self, callbacks: Callbacks) -> str:
        """Trains to the last iteration, or returns why not."""
        _, oldest_attempt = self._release(self._done)
        for iteration in range(self._done, self._config.iterations):
            if callbacks.stopped:
                log.info("%s", callbacks.stopped)
                return callbacks.stopped
            start_s = time.monotonic()
            episodes = self._collect(iteration, oldest_attempt)
            collect_s = time.monotonic() - start_s
            self._take(iteration, episodes)
            callbacks.collection_end(
                CollectionEnd(
                    iteration,
                    tuple(float(one.rewards.sum()) for one in episodes),
                    tuple(one.episode.steps for one in episodes),
                )
            )
            update = self._update(iteration)
            weights, oldest_attempt = self._release(iteration + 1)
            seconds = {"collect_s": collect_s, "iteration_s": time.monotonic() - start_s}
            record = self._record(iteration, episodes, update, weights) | seconds
            record |= callbacks.update_end(iteration, record, weights)
            if self._stop.is_set():  # an evaluation may have been cut short
                raise UpdateStopped(f"stopped before iteration {iteration} was written down")
            self._insist("metrics", partial(self._owner.append_metrics, record))
            # Last: a crash before this line repeats the iteration, to the same result.
            checkpoint = encode_checkpoint(self._network, self._optimizer, iteration + 1)
            self._insist("the checkpoint", partial(self._owner.write_checkpoint, checkpoint))
            self._report(iteration, {k: v for k, v in record.items() if isinstance(v, float)})
        return ""

    def _evaluate(self, iteration: int, weights: Weights, episodes: int) -> EvaluationEnd | None:
        if self._evaluations is None:
            raise RuntimeError("there is nobody who would play it")
        return self._evaluations.play(iteration, weights, episodes, self._stop)

    def _insist(self, what: str, write: Callable[[], object]) -> None:
        insist(what, write, waiting=self._waiting, stop=self._stop)

    def _restore(self) -> None:
        """The data sets that the next update needs, each with all its episodes."""
        if self._config.init_from and not self._done:
            run, version, _ = self._config.init_from.split(":")
            log.info(
                "begins with version %s of run %s: its weights, batch-norm statistics and lambda; Adam's moments, "
                "learning rates and data are this run's own", version, run,
            )  # fmt: skip
        if self._done:
            self._history.check_policy(self._network, self._done)
            log.info("resumes after %d of %d iterations", self._done, self._config.iterations)
        for iteration in self._remembered():
            self._take(iteration, self._data_set(iteration))

    def _remembered(self) -> range:
        """The iterations that are D when the training goes on."""
        transitions = [self._history.transitions(i) for i in range(self._done)]
        return range(self._done - self._memory.kept(transitions), self._done)

    def _data_set(self, iteration: int) -> list[Scored]:
        """All episodes of an iteration that is done; what is missing is played again, with its weights."""
        stored = load_episodes(self._owner, self._config, iteration)
        if len(stored) == self._config.episodes:
            return [stored[episode] for episode in sorted(stored)]
        log.warning(
            "%d of the %d episodes of iteration %d are there: the others are played again",
            len(stored), self._config.episodes, iteration,
        )  # fmt: skip
        self._publish(self._history.weights(iteration, self._owner.attempt))
        return self._collect(iteration)

    def _load_policy(self) -> None:
        """Sets network and optimizer to the last checkpoint's, or else to what they were at the beginning."""
        self._network, self._optimizer, _ = self._history.load_policy()

    def _release(self, version: int) -> tuple[Weights, int]:
        """Exports the network, keeps the policy in the run folder and sends it out.

        Returns:
            The policy, and the oldest attempt whose version of that number is the same; 0 if all are.
        """
        folder, attempt = self._owner.folder, self._owner.attempt
        weights = self._network.export(run=folder.run, attempt=attempt, version=version)
        before = self._history.weights_sha256(version)
        is_other = before is not None and before != weights.content_sha256()
        if is_other:
            log.warning(
                "weights version %d is another than in an earlier attempt%s", version,
                ", though it was computed from the same data" * self._history.is_repeatable,
            )  # fmt: skip
        self._insist(f"weights version {version}", lambda: self._owner.write_weights(weights))
        self._publish(weights)
        return weights, attempt if is_other else 0

    def _collect(self, iteration: int, oldest_attempt: int = 0) -> list[Scored]:
        self._ledger.begin(iteration, oldest_attempt)
        episodes = self._ledger.wait_complete(
            self._stop,
            lambda count: self._report(iteration, {"progress.episodes": float(count)}),
        )
        if episodes is None:
            raise UpdateStopped(f"stopped while iteration {iteration} was collected")
        return episodes

    def _take(self, iteration: int, episodes: list[Scored]) -> None:
        """Makes an iteration's episodes the newest data set, and keeps their rewards for who looks at them."""
        self._memory.add(
            [
                EpisodeData(
                    frames=scored.episode.frames,
                    actions=scored.episode.actions,
                    rewards=scored.rewards,
                    terminated=scored.episode.meta.terminated,
                )
                for scored in episodes
            ]
        )
        rewards_px = [np.round(data.rewards, 3).tolist() for data in self._memory.newest]
        if not self._history.check_rewards(iteration, episodes, rewards_px):
            self._insist("rewards", lambda: self._owner.append_rewards(iteration, rewards_px))

    def _update(self, iteration: int) -> UpdateReport:
        """One policy update; where others share it, again from the checkpoint until none was lost."""
        config, episodes = self._config, self._memory.episodes
        D = data_of(config, episodes, self._reward_scale.of(episodes))
        again = None
        if levels := parse(config.augment):
            again = data_of(config, seen_again(episodes, levels, config.seed, iteration))
        for given_up in range(1, GIVE_UP_AFTER + 1):
            try:
                return self._try_update(iteration, D, again)
            except GroupLostError as error:
                if given_up == GIVE_UP_AFTER:
                    raise
                log.warning("a learner was lost: the update begins again (%s)", error)
                self._load_policy()
        raise AssertionError("unreachable")

    def _try_update(
        self, iteration: int, D: Transitions, again: Transitions | None
    ) -> UpdateReport:
        def progress(epochs: int, _total: int) -> None:
            self._report(iteration, {"progress.epochs": float(epochs)})

        return policy_update(
            self._network,
            self._optimizer,
            D,
            UpdateConfig.of_iteration(self._config, iteration),
            shuffle_generator(self._config.seed, iteration),
            again=again,
            gather=lambda regression: self._gathered(iteration, regression),
            progress=progress,
            stop=self._stop.is_set,
        )

    @contextlib.contextmanager
    def _gathered(self, iteration: int, regression: RegressionBatch) -> Iterator[Group]:
        """The learners that share the update, once all of them know what it is."""
        if self._rendezvous is None:
            yield SINGLE_PROCESS
            return
        with self._rendezvous.gathered() as group:
            broadcast_state(group, self._network, self._optimizer, regression, iteration)
            yield group
            self._exchange_s = group.exchange_s

    def _successes(self, episodes: list[Scored]) -> dict[str, int]:
        """How many succeeded, if that is defined."""
        task = self._config.task_spec
        told = [
            success_of(task, scored.episode.meta, data.rewards)
            for scored, data in zip(episodes, self._memory.newest, strict=True)
        ]
        return {} if share(told) is None else {"successes": sum(map(bool, told))}

    def _record(
        self, iteration: int, episodes: list[Scored], update: UpdateReport, weights: Weights
    ) -> dict[str, float | int | str | list[float]]:
        """The iteration's line in the run folder; docs/metrics.md explains every value."""
        returns = [float(episode.rewards.sum()) for episode in self._memory.newest]
        name = self._config.task_spec.return_metric
        lengths = [scored.episode.steps for scored in episodes]
        metas = [scored.episode.meta for scored in episodes]
        return {
            "iteration": iteration,
            "attempt": self._owner.attempt,
            "time_unix_s": time.time(),
            "episodes": len(episodes),
            "transitions": sum(lengths),
            name: float(np.mean(returns)),
            name.replace("return", "returns"): returns,
            "length": float(np.mean(lengths)),
            "terminated": sum(meta.terminated for meta in metas),
            **self._successes(episodes),
            "deadline_misses": sum(meta.deadline_misses for meta in metas),
            "loss_first": update.loss_first,
            "loss": update.loss_last,
            "max_preference": update.max_preference,
            "max_target": update.max_target,
            "scale": update.scale,
            "reward_scale": self._reward_scale.found,
            "entropy": update.entropy,
            "agreement": update.agreement,
            "saturation": update.saturation,
            "epsilon": self._config.epsilon(iteration),
            "updates": update.updates,
            "update_s": update.seconds,
            "exchange_s": self._exchange_s,
            "weights_version_lag": self._ledger.weights_version_lag(),
            "weights_version": weights.version,
            "weights_sha256": weights.content_sha256(),
        }
