"""Algorithm 1 over the bus: collect, learn, publish, checkpoint, for I iterations."""

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pkgutil import resolve_name
from typing import TYPE_CHECKING

import numpy as np

from bpn_learner.checkpoint import load_checkpoint, save_checkpoint
from bpn_learner.export import export
from bpn_learner.group import ALONE, Group, GroupLostError
from bpn_learner.handout import hand_out
from bpn_learner.initial import initial_policy
from bpn_learner.ledger import EpisodeLedger, load_episodes
from bpn_learner.rendezvous import Rendezvous
from bpn_learner.reward import episode_rewards
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import (
    PolicyUpdate,
    Regression,
    UpdateReport,
    UpdateStopped,
    policy_update,
)
from bpn_shared.config import ConfigError, RunConfig
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder
from bpn_shared.seeds import shuffle_generator
from bpn_shared.service import Waiting
from bpn_shared.success import share, success_of
from bpn_shared.weights import Weights

if TYPE_CHECKING:
    from bpn_learner.events import EventWriter  # an extra: loaded when a run asks for it

log = logging.getLogger(__name__)

GIVE_UP_AFTER = 8
"""Updates of one iteration in a row that were given up because a learner was lost."""

Report = Callable[[int, Mapping[str, float]], None]
"""Publishes live values (name to value) of an iteration."""


class Training:
    """One attempt at a run, from where its checkpoint stands.

    Args:
        attempt: stamped on the weights, so that edges prefer them to an earlier learner's.
        publish: sends weights to the edges.
        report: publishes live progress.
        rendezvous: gathers the other learners for every update; None: there are none.
        stop: ends the training as soon as possible; nothing is lost by it.
    """

    def __init__(
        self,
        config: RunConfig,
        folder: RunFolder,
        ledger: EpisodeLedger,
        *,
        attempt: int,
        publish: Callable[[Weights], None],
        report: Report,
        rendezvous: Rendezvous | None,
        waiting: Waiting,
        stop: threading.Event,
    ) -> None:
        self._config, self._folder, self._ledger = config, folder, ledger
        self._attempt, self._publish, self._report = attempt, publish, report
        self._waiting, self._stop = waiting, stop
        self._rendezvous, self._exchange_s = rendezvous, 0.0
        self._network, self._optimizer = initial_policy(config)
        self._data: deque[list[EpisodeData]] = deque(maxlen=config.datasets)  # D

    def run(self) -> bool:
        """Trains to the last iteration.

        Returns:
            False if `stop` ended it before.

        Raises:
            CheckpointError: the run folder's checkpoint is unusable.
            DivergenceError: the loss is no longer finite.
            GroupLostError: other learners were lost in every one of many tries.
            RewardError: a frame shows no marker.
        """
        done = self._restore()
        events = _event_writer(self._config, self._folder, done)
        self._release(done)
        for iteration in range(done, self._config.iterations):
            start_s = time.monotonic()
            episodes = self._collect(iteration)
            if episodes is None:
                return False
            collect_s = time.monotonic() - start_s
            self._data.append([self._learnable(episode) for episode in episodes])
            self._keep_rewards(iteration)
            try:
                update = self._update(iteration)
            except UpdateStopped:
                return False
            weights = self._release(iteration + 1)
            seconds = {"collect_s": collect_s, "iteration_s": time.monotonic() - start_s}
            record = self._record(iteration, episodes, update, weights) | seconds
            self._folder.append_metrics(record)
            if events is not None:
                events.write(record)
            # Last: a crash before this line repeats the iteration, to the same result.
            save_checkpoint(
                self._folder.checkpoint_path, self._network, self._optimizer, iteration + 1
            )
            self._report(iteration, {k: v for k, v in record.items() if isinstance(v, float)})
        return True

    def _restore(self) -> int:
        done = self._load_policy()
        for iteration in range(max(0, done - self._config.datasets), done):
            stored = load_episodes(self._folder, self._config, iteration)
            self._data.append([self._learnable(stored[episode]) for episode in sorted(stored)])
        if done:
            log.info("resumes after %d of %d iterations", done, self._config.iterations)
        return done

    def _load_policy(self) -> int:
        """Sets network and optimizer to the last checkpoint's, or else to what they were at the beginning."""
        self._network, self._optimizer = initial_policy(self._config)
        if not self._folder.checkpoint_path.exists():
            return 0
        done = load_checkpoint(self._folder.checkpoint_path, self._network, self._optimizer)
        self._network.eval()
        return done

    def _release(self, version: int) -> Weights:
        """Exports the network, keeps the policy in the run folder and sends it out."""
        weights = export(
            self._network, run=self._folder.run, attempt=self._attempt, version=version
        )
        write_atomically(self._folder.weights_path(version), weights.encode())
        self._publish(weights)
        return weights

    def _collect(self, iteration: int) -> list[Episode] | None:
        self._waiting.set(f"{self._config.episodes} episodes of iteration {iteration}")
        self._ledger.begin(iteration, self._attempt)
        episodes = self._ledger.wait_complete(
            self._stop,
            lambda count: self._report(iteration, {"progress.episodes": float(count)}),
        )
        self._waiting.done()
        return episodes

    def _learnable(self, episode: Episode) -> EpisodeData:
        """The episode with its rewards; the paper's tasks have them from the pixels alone (section VI-A)."""
        rewards = episode_rewards(self._config.task_spec, episode)
        return EpisodeData(
            frames=episode.frames,
            actions=episode.actions,
            rewards=rewards * self._config.reward_scale,
            terminated=episode.meta.terminated,
        )

    def _keep_rewards(self, iteration: int) -> None:
        """For whoever looks at an episode later: they are the learner's alone to compute."""
        scale = self._config.reward_scale
        rewards_px = [np.round(episode.rewards / scale, 3).tolist() for episode in self._data[-1]]
        self._folder.append_rewards(iteration, rewards_px)

    def _update(self, iteration: int) -> UpdateReport:
        """One policy update; where others share it, again from the checkpoint until none was lost."""
        D = Transitions.from_episodes(
            [episode for dataset in self._data for episode in dataset],
            frames_stacked=self._config.task_spec.frames_stacked,
        )
        for given_up in range(1, GIVE_UP_AFTER + 1):
            try:
                return self._try_update(iteration, D)
            except GroupLostError as error:
                if given_up == GIVE_UP_AFTER:
                    raise
                log.warning("a learner was lost: the update begins again (%s)", error)
                self._load_policy()
        raise AssertionError("unreachable")

    def _try_update(self, iteration: int, D: Transitions) -> UpdateReport:
        def progress(epochs: int, _total: int) -> None:
            self._report(iteration, {"progress.epochs": float(epochs)})

        return policy_update(
            self._network,
            self._optimizer,
            D,
            PolicyUpdate.of_iteration(self._config, iteration),
            shuffle_generator(self._config.seed, iteration),
            gather=lambda regression: self._gathered(iteration, regression),
            progress=progress,
            stop=self._stop.is_set,
        )

    @contextlib.contextmanager
    def _gathered(self, iteration: int, regression: Regression) -> Iterator[Group]:
        """The learners that share the update, once all of them know what it is."""
        if self._rendezvous is None:
            yield ALONE
            return
        with self._rendezvous.gathered() as group:
            hand_out(group, self._network, self._optimizer, regression, iteration)
            yield group
            self._exchange_s = group.exchange_s

    def _successes(self, episodes: list[Episode]) -> dict[str, int]:
        """How many succeeded, if that is defined."""
        task, scale = self._config.task_spec, self._config.reward_scale
        told = [
            success_of(task, episode.meta, data.rewards / scale)
            for episode, data in zip(episodes, self._data[-1], strict=True)
        ]
        return {} if share(told) is None else {"successes": sum(map(bool, told))}

    def _record(
        self, iteration: int, episodes: list[Episode], update: UpdateReport, weights: Weights
    ) -> dict[str, float | int | str | list[float]]:
        """The iteration's line in the run folder; docs/metrics.md explains every value."""
        scale = self._config.reward_scale
        returns = [float(episode.rewards.sum()) / scale for episode in self._data[-1]]
        name = self._config.task_spec.return_metric
        lengths = [episode.steps for episode in episodes]
        return {
            "iteration": iteration,
            "attempt": self._attempt,
            "time_unix_s": time.time(),
            "episodes": len(episodes),
            "transitions": sum(lengths),
            name: float(np.mean(returns)),
            name.replace("return", "returns"): returns,
            "length": float(np.mean(lengths)),
            "terminated": sum(episode.meta.terminated for episode in episodes),
            **self._successes(episodes),
            "deadline_misses": sum(episode.meta.deadline_misses for episode in episodes),
            "loss_first": update.loss_first,
            "loss": update.loss_last,
            "max_preference": update.max_preference,
            "max_target": update.max_target,
            "scale": update.scale,
            "saturation": update.saturation,
            "epsilon": self._config.epsilon(iteration),
            "updates": update.updates,
            "update_s": update.seconds,
            "exchange_s": self._exchange_s,
            "weights_version_lag": self._ledger.weights_version_lag(),
            "weights_version": weights.version,
            "weights_sha256": weights.content_sha256(),
        }


def _event_writer(config: RunConfig, folder: RunFolder, first: int) -> "EventWriter | None":
    """What writes TensorBoard's files, if the run asks for them.

    Raises:
        ConfigError: TensorBoard is not installed.
    """
    if not config.tensorboard:
        return None
    try:
        writer: EventWriter = resolve_name("bpn_learner.events:EventWriter")(
            folder.path / "tensorboard", config, first
        )
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"tensorboard = True needs {error.name}, which is not installed: "
            "pip install 'bpn-learner[tensorboard]'"
        ) from error
    return writer
