"""The edge's end of the two requests to its learner: what to play next, and here is an episode."""

import random
from collections.abc import Callable
from typing import TypeVar

from bpn_shared import keys
from bpn_shared.bus.requests import NoReplyError, RefusedError, request
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import Assignment, EpisodeReceipt, NextEpisode
from bpn_shared.messages.episode import Episode
from bpn_shared.worker import Worker

_ASK_TIMEOUT_S = 2.0
_DELIVER_TIMEOUT_S = 10.0
_AGAIN_S = 0.1
_LONGEST_ABSENT_S, _LONGEST_REFUSED_S = 0.5, 5.0
_REFUSALS = 3
_Answer = TypeVar("_Answer")
SOONEST_S, LATEST_S = 0.02, 0.5


class Pace:
    """How long an edge without work waits before it asks again: longer each time, until there is news.

    An update takes seconds, and whoever asks meanwhile takes processor time from it.
    """

    def __init__(self) -> None:
        self._pause_s = SOONEST_S

    def next_pause_s(self) -> float:
        """The pause before the next question."""
        pause_s, self._pause_s = self._pause_s, min(2 * self._pause_s, LATEST_S)
        return pause_s

    def quicken(self) -> None:
        """There is news: the answer is probably another one soon."""
        self._pause_s = SOONEST_S


class RefusedAgainError(RuntimeError):
    """The learner refuses the same bytes for the same reason; the message is the reason."""


class LearnerLink:
    """Asks and delivers until the learner answers, however often it is restarted meanwhile."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker

    def next_episode(self, weights_version: int | None) -> Assignment | None:
        """What this slot shall play; None if the worker was stopped.

        Args:
            weights_version: the newest that is here; None: none.
        """
        worker = self._worker
        asked = NextEpisode(slot=worker.slot, worker=worker.id, weights_version=weights_version)
        key = keys.next_episode(worker.run)
        return self._insist(
            key, asked.encode(), Assignment.decode, _ASK_TIMEOUT_S, "an episode", refusals=None
        )

    def deliver(self, episode: Episode) -> None:
        """Returns once the learner has taken the episode, has it already, or does not want it.

        Raises:
            RefusedAgainError: it refuses the episode as such; there is no use in delivering it again.
        """
        worker = self._worker
        which = f"episode ({episode.meta.iteration}, {episode.meta.episode})"
        receipt = self._insist(
            keys.episode(worker.run),
            episode.encode(),
            EpisodeReceipt.decode,
            _DELIVER_TIMEOUT_S,
            f"a receipt for {which}",
            refusals=_REFUSALS,
        )
        if receipt is None:
            return
        worker.waiting.done()
        worker.counters.add(f"episodes_{receipt.verdict}")
        if receipt.verdict == "refused":
            worker.counters.refuse("episodes_not_wanted", f"{which}: {receipt.reason}")

    def _insist(
        self,
        key: str,
        body: bytes,
        decode: Callable[[bytes], _Answer],
        timeout_s: float,
        what: str,
        *,
        refusals: int | None,
    ) -> _Answer | None:
        """The answer; None if the worker was stopped.

        Args:
            refusals: after so many in a row for one reason it gives up; None: never, other questions may be
                answered.
        """
        worker, pause_s = self._worker, _AGAIN_S
        last, times = "", 0
        while not worker.stop.is_set():
            try:
                return decode(request(worker.bus, key, body, timeout_s=timeout_s))
            except NoReplyError:
                worker.waiting.set(f"the learner to give {what}")
                longest_s, times = _LONGEST_ABSENT_S, 0
            except (RefusedError, MessageError) as error:
                reason = f"the learner refuses to give {what}: {error}"
                worker.counters.refuse("requests_refused_by_learner", reason)
                worker.waiting.set(f"the learner, which refuses to give {what}: {error}")
                longest_s, times = _LONGEST_REFUSED_S, times + 1 if reason == last else 1
                last = reason
                if times == refusals:
                    raise RefusedAgainError(str(error)) from error
            worker.stop.wait(pause_s * random.uniform(0.5, 1.0))  # noqa: S311 - only apart
            pause_s = min(2 * pause_s, longest_s)
        return None
