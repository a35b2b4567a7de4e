"""Which episodes of the iteration are where: handed out, on disk, or still to be played.

Nothing is lost: an episode is acknowledged only once it is on disk, and one whose edge died is handed out
again. Nothing counts twice: an episode is its (iteration, episode), and the first delivery stands.
"""

import logging
import statistics
import threading
import time
from collections.abc import Callable, Container
from dataclasses import dataclass

import numpy as np

from bpn_shared.config import RunConfig
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import Assignment, EpisodeReceipt, NextEpisode
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder
from bpn_shared.seeds import episode_seed

log = logging.getLogger(__name__)

LEASE_S = 60.0
"""Grace on top of the time that an episode takes in realtime pacing."""


@dataclass(frozen=True, slots=True)
class Lease:
    """Who plays an episode, and until when that is believed."""

    slot: int
    worker: str
    expires_s: float


class EpisodeLedger:
    """The current iteration's episodes. Its methods may be called from any thread.

    Args:
        alive: the edges that are alive now; a lease of one that is not has ended.
    """

    def __init__(self, config: RunConfig, folder: RunFolder, alive: Container[str]) -> None:
        self._config, self._folder, self._alive = config, folder, alive
        self._lease_s = LEASE_S + config.steps * config.task_spec.control_period_s
        self._changed = threading.Condition()
        self._iteration = -1
        self._attempt = 0
        self._collecting = False
        self._finished = False
        self._told: dict[int, bool] = {}  # by slot that has asked: whether it knows of the end
        self._stored: dict[int, Episode] = {}
        self._leases: dict[int, Lease] = {}
        self._lags: list[int] = []
        self.redelivered = 0
        """Deliveries of episodes that were there already: an acknowledgement had been lost."""

    def begin(self, iteration: int, attempt: int) -> None:
        """Starts handing out an iteration's episodes, but for those that are on disk already."""
        stored = load_episodes(self._folder, self._config, iteration)
        with self._changed:
            self._iteration, self._attempt = iteration, attempt
            self._stored, self._leases = stored, {}
            self._lags = []
            self._collecting = True
            self._changed.notify_all()

    def wait_complete(
        self, stop: threading.Event, on_progress: Callable[[int], None]
    ) -> list[Episode] | None:
        """Waits for all episodes of the iteration, in order of e; None if stopped before."""
        reported = -1
        with self._changed:
            while len(self._stored) < self._config.episodes:
                if stop.is_set():
                    return None
                if len(self._stored) != reported:
                    reported = len(self._stored)
                    on_progress(reported)
                self._changed.wait(timeout=0.2)  # bounded, so that `stop` is seen
            self._collecting = False
            return [self._stored[episode] for episode in sorted(self._stored)]

    def finish(self) -> None:
        """From now on edges are told that the run is finished."""
        with self._changed:
            self._finished = True

    def wait_told(self, stop: threading.Event, timeout_s: float) -> None:
        """Waits, for a bounded time, until every slot that played has been told of the end."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while not (all(self._told.values()) or stop.is_set() or time.monotonic() > deadline_s):
                self._changed.wait(timeout=0.1)  # bounded, so that `stop` is seen

    def weights_version_lag(self) -> float:
        """How many versions edges were behind when they were handed episodes of this iteration, on average."""
        with self._changed:
            return statistics.fmean(self._lags) if self._lags else 0.0

    def next(self, asked: NextEpisode) -> Assignment:
        """The episode that a slot shall play now."""
        with self._changed:
            self._told[asked.slot] = self._finished
            self._changed.notify_all()
            if self._finished:
                return Assignment(verdict="finished", reason="all iterations are done")
            if not self._collecting:
                return Assignment(verdict="wait", reason="the policy update")
            episode = self._choose(asked)
            if episode is None:
                return Assignment(verdict="wait", reason="the other robots' episodes")
            expires_s = time.monotonic() + self._lease_s
            self._leases[episode] = Lease(asked.slot, asked.worker, expires_s)
            if asked.weights_version is not None:
                self._lags.append(max(0, self._iteration - asked.weights_version))
            return Assignment(
                verdict="play",
                iteration=self._iteration,
                episode=episode,
                seed=episode_seed(self._config.seed, self._iteration, episode),
                weights_attempt=self._attempt,
                weights_version=self._iteration,  # theta-minus has seen as many updates
                policy=self._config.policy,
                epsilon=self._config.epsilon(self._iteration),
            )

    def _choose(self, asked: NextEpisode) -> int | None:
        missing = [e for e in range(self._config.episodes) if e not in self._stored]
        # A slot that asks has nothing in hand: what it was given before is its again.
        mine = [e for e in missing if e in self._leases and self._leases[e].slot == asked.slot]
        free = [e for e in missing if not self._held(e)]
        return next(iter(mine + free), None)

    def _held(self, episode: int) -> bool:
        lease = self._leases.get(episode)
        return (
            lease is not None and lease.worker in self._alive and time.monotonic() < lease.expires_s
        )

    def receive(self, data: bytes) -> EpisodeReceipt:
        """Takes a delivered episode: on disk when this returns "stored".

        Raises:
            MessageError: the bytes are no episode of this run's task.
        """
        episode = Episode.decode(data, self._config.task_spec)
        meta = episode.meta
        with self._changed:
            reason = self._unwanted(episode)
            if reason is not None:
                log.warning("episode (%d, %d) refused: %s", meta.iteration, meta.episode, reason)
                return EpisodeReceipt(verdict="refused", reason=reason)
            if meta.iteration < self._iteration or meta.episode in self._stored:
                self.redelivered += 1
                return EpisodeReceipt(verdict="duplicate")
            write_atomically(self._folder.episode_path(meta.iteration, meta.episode), data)
            self._stored[meta.episode] = episode
            self._leases.pop(meta.episode, None)
            self._changed.notify_all()
            return EpisodeReceipt(verdict="stored")

    def _unwanted(self, episode: Episode) -> str | None:
        meta = episode.meta
        if meta.iteration > self._iteration:
            return f"iteration {meta.iteration} has not begun"
        if meta.weights_version != meta.iteration:
            return f"played with weights version {meta.weights_version}"
        return why_invalid(episode, self._config)


def why_invalid(episode: Episode, config: RunConfig) -> str | None:
    """What keeps an episode from being data of a run with this configuration, if anything does."""
    meta = episode.meta
    if meta.episode >= config.episodes:
        return f"an iteration has episodes 0..{config.episodes - 1}"
    if meta.seed != episode_seed(config.seed, meta.iteration, meta.episode):
        return f"seed {meta.seed} is another run's"
    outputs = "int32" if config.algorithm_spec.network == "binary" else "float32"
    if episode.outputs.dtype.name != outputs:
        return f"outputs are {episode.outputs.dtype.name}, {config.algorithm} has {outputs}"
    told = config.task_spec.rewards == "robot"
    if told and not np.isfinite(episode.rewards).all():
        return "not every step has a reward, the task's come from the robot"
    may_be_short = (
        meta.terminated or told
    )  # such an environment may end an episode for reasons of its own
    if episode.steps > config.steps or (episode.steps < config.steps and not may_be_short):
        return f"{episode.steps} steps, an episode of this run has {config.steps}"
    return None


def load_episodes(folder: RunFolder, config: RunConfig, iteration: int) -> dict[int, Episode]:
    """An iteration's stored episodes by e. A damaged file is set aside, its episode played again."""
    stored: dict[int, Episode] = {}
    for index in range(config.episodes):
        path = folder.episode_path(iteration, index)
        if not path.exists():
            continue
        try:
            stored[index] = Episode.decode(path.read_bytes(), config.task_spec)
        except MessageError as error:
            log.warning("%s is damaged (%s): set aside, the episode is played again", path, error)
            path.rename(path.with_suffix(".damaged"))
    return stored
