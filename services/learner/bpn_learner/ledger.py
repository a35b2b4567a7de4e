"""Which episodes of the iteration are where: handed out, on disk, or still to be played.

Nothing is lost: an episode is acknowledged only once it is on disk, and one whose edge died is handed out
again. Nothing counts twice: an episode is its (iteration, episode), and the first delivery stands. Nothing is
taken that cannot be learned from: its rewards are computed before it is stored.
"""

import logging
import statistics
import threading
import time
from collections.abc import Callable, Container

from bpn_learner.episodes import EpisodeError, Scored, load_episodes, score
from bpn_learner.lease import Lease
from bpn_learner.refusals import EpisodeImpossibleError, EpisodeRefusals
from bpn_learner.storage import StorageError, trouble
from bpn_shared.counters import Counters
from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.control import (
    Assignment,
    EpisodeReceipt,
    Fault,
    FaultReceipt,
    NextEpisode,
)
from bpn_shared.messages.episode import Episode, EpisodeMeta, decode_meta
from bpn_shared.runs.lock import OwnershipLostError
from bpn_shared.runs.ownership import Ownership
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed
from bpn_shared.waiting import WaitStatus

log = logging.getLogger(__name__)

PROVE_S = 1.0
"""How often who waits for episodes looks whether the run is still its own."""
_MAX_REASON = 400


class EpisodeLedger:
    """The current iteration's episodes. Its methods may be called from any thread.

    Args:
        owner: keeps the episodes.
        alive: the edges that are alive now; a lease of one that is not has ended.
        waiting: is told what is waited for.
        counters: `episodes_refused` and `episode_faults` are counted here.
    """

    def __init__(
        self,
        config: RunConfig,
        owner: Ownership,
        alive: Container[str],
        waiting: WaitStatus,
        counters: Counters,
    ) -> None:
        self._config, self._owner, self._alive = config, owner, alive
        self._waiting, self._counters = waiting, counters
        self._changed = threading.Condition()
        self._iteration = -1
        self._oldest_attempt = 0
        self._collecting = False
        self._finished = False
        self._told: dict[int, bool] = {}  # by slot that has asked: whether it knows of the end
        self._stored: dict[int, Scored] = {}
        self._leases: dict[int, Lease] = {}
        self._lags: list[int] = []
        self._refusals = EpisodeRefusals()
        self._obstacle = ""
        self._failure: Exception | None = None
        self.redelivered = 0
        """Deliveries of episodes that were there already: an acknowledgement had been lost."""

    def begin(self, iteration: int, oldest_attempt: int = 0) -> None:
        """Starts handing out an iteration's episodes, but for those that are on disk already.

        Args:
            oldest_attempt: the first attempt whose weights of that version are those of now: what older ones
                played is no data.

        Raises:
            DataError: a file of an episode cannot be read, or another version wrote it.
            OwnershipLostError: another learner has taken the run over.
        """
        stored = load_episodes(self._owner, self._config, iteration, oldest_attempt)
        with self._changed:
            self._iteration, self._oldest_attempt = iteration, oldest_attempt
            self._stored, self._leases = stored, {}
            self._lags = []
            self._refusals, self._obstacle = EpisodeRefusals(), ""
            self._collecting = True
            self._changed.notify_all()

    def wait_complete(
        self, stop: threading.Event, on_progress: Callable[[int], None]
    ) -> list[Scored] | None:
        """Waits for all episodes of the iteration, in order of e; None if stopped before.

        Raises:
            EpisodeImpossibleError: one of them cannot be had.
            OwnershipLostError: another learner has taken the run over.
        """
        reported, prove_at_s = -1, time.monotonic() + PROVE_S
        while True:
            with self._changed:
                if self._failure is not None:
                    raise self._failure
                count = len(self._stored)
                if count == self._config.episodes:
                    self._collecting = False
                    self._waiting.done()
                    return [self._stored[episode] for episode in sorted(self._stored)]
                if stop.is_set():
                    return None
                self._waiting.set(
                    self._obstacle
                    or f"{self._config.episodes} episodes of iteration {self._iteration}"
                )
                if count == reported:
                    self._changed.wait(timeout=0.2)  # bounded, so that `stop` is seen
            if count != reported:
                on_progress(count)
                reported = count
            if time.monotonic() > prove_at_s:
                self._owner.prove()
                prove_at_s = time.monotonic() + PROVE_S

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
                return Assignment(status="finished", reason="all iterations are done")
            if not self._collecting:
                return Assignment(status="wait", reason="the policy update")
            lease = Lease.begin(asked, self._config)
            in_hand = self._in_hand(asked)
            if in_hand is not None:
                self._leases[in_hand] = lease
            episode = self._choose(asked.slot, in_hand)
            if episode is None:
                return Assignment(status="wait", reason="the other robots' episodes")
            self._leases[episode] = lease
            if asked.weights_version is not None:
                self._lags.append(max(0, self._iteration - asked.weights_version))
            return Assignment(
                status="play",
                iteration=self._iteration,
                episode=episode,
                seed=episode_seed(self._config.seed, self._iteration, episode),
                weights_attempt=self._owner.attempt,
                weights_version=self._iteration,  # theta-minus has seen as many updates
                policy=self._config.policy,
                epsilon=self._config.epsilon(self._iteration),
            )

    def _in_hand(self, asked: NextEpisode) -> int | None:
        """What a slot has played and not delivered yet, if it is of this iteration and still missing."""
        iteration, episode = asked.in_hand or (-1, -1)
        is_missing = 0 <= episode < self._config.episodes and episode not in self._stored
        return episode if iteration == self._iteration and is_missing else None

    def _choose(self, slot: int, in_hand: int | None) -> int | None:
        # What a slot was given before and has not in hand, it has lost: that is its again.
        mine = [e for e, lease in self._leases.items() if lease.slot == slot and e != in_hand]
        if mine:
            return min(mine)
        missing = (e for e in range(self._config.episodes) if e not in self._stored)
        return next((e for e in missing if not self._held(e)), None)

    def _held(self, episode: int) -> bool:
        lease = self._leases.get(episode)
        return lease is not None and lease.holds(self._alive)

    def receive(self, data: bytes) -> EpisodeReceipt:
        """Takes a delivered episode: on disk when this returns "stored".

        Raises:
            MessageError: the bytes are no episode.
            StorageError: it cannot be kept now; nothing of it is, and it has to be delivered again.
        """
        try:
            episode = Episode.decode(data, self._config.task_spec)
        except OtherVersionError as error:
            with self._changed:
                self._obstacle = f"episodes that can be read: {error}"
            raise
        except MessageError as error:
            meta, _ = decode_meta(data)  # raises, if it is not even known which one it is
            return self._refuse(meta, str(error))
        meta = episode.meta
        with self._changed:
            if reason := self._untimely(meta):
                return self._refuse(meta, reason, counts=False)
            if self._is_there(meta):
                return EpisodeReceipt(status="duplicate")
        try:
            scored = score(episode, self._config)
        except EpisodeError as error:
            return self._refuse(meta, str(error))
        with self._changed:
            if self._is_there(meta):
                return EpisodeReceipt(status="duplicate")
            self._store(scored, data)
            self._leases.pop(meta.episode, None)
            self._obstacle = ""
            self._changed.notify_all()
            return EpisodeReceipt(status="stored")

    def _untimely(self, meta: EpisodeMeta) -> str | None:
        """Why an episode is not of what is collected now, though it may be a good one."""
        if meta.iteration > self._iteration:
            return f"iteration {meta.iteration} has not begun"
        if meta.iteration < self._iteration:
            return None  # a duplicate
        attempt = self._owner.attempt
        if not self._oldest_attempt <= meta.weights_attempt <= attempt:
            return f"weights of attempt {meta.weights_attempt} played it, those of attempt {attempt} are others"
        return None

    def _is_there(self, meta: EpisodeMeta) -> bool:
        there = meta.iteration < self._iteration or (
            meta.iteration == self._iteration and meta.episode in self._stored
        )
        self.redelivered += there
        return there

    def _store(self, scored: Scored, data: bytes) -> None:
        meta = scored.episode.meta
        which = f"episode ({meta.iteration}, {meta.episode})"
        try:
            self._owner.write_episode(meta.iteration, meta.episode, data)
        except OwnershipLostError as error:
            self._failure = error
            self._changed.notify_all()
            raise StorageError(str(error)) from error
        except OSError as error:
            self._obstacle = trouble(which, error)
            self._changed.notify_all()
            raise StorageError(f"waits for {self._obstacle}") from error
        self._stored[meta.episode] = scored

    def _refuse(self, meta: EpisodeMeta, reason: str, *, counts: bool = True) -> EpisodeReceipt:
        reason = reason[:_MAX_REASON]
        self._counters.refuse(
            "episodes_refused", f"episode ({meta.iteration}, {meta.episode}) refused: {reason}"
        )
        if counts:
            self._count(meta.iteration, meta.episode, reason)
        return EpisodeReceipt(status="refused", reason=reason)

    def fault(self, fault: Fault) -> FaultReceipt:
        """Notes that an episode cannot be had."""
        self._counters.refuse(
            "episode_faults",
            f"episode ({fault.iteration}, {fault.episode}) cannot be had, {fault.worker} says: {fault.reason}",
        )
        self._count(fault.iteration, fault.episode, fault.reason)
        return FaultReceipt()

    def _count(self, iteration: int, episode: int, reason: str) -> None:
        with self._changed:
            missing = episode < self._config.episodes and episode not in self._stored
            if iteration == self._iteration and self._collecting and missing:
                why = self._refusals.add(episode, reason)
                if why is not None and self._failure is None:
                    which = f"episode ({iteration}, {episode})"
                    self._failure = EpisodeImpossibleError(f"{which} cannot be had: {why}")
                self._changed.notify_all()
