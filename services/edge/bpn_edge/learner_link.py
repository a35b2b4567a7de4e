"""The edge's end of the two requests to its learner: what to play next, and here is an episode."""

from bpn_shared import keys
from bpn_shared.bus.requests import NoReplyError, RefusedError, request
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import Assignment, EpisodeReceipt, NextEpisode
from bpn_shared.messages.episode import Episode
from bpn_shared.worker import Worker

_ASK_TIMEOUT_S = 2.0
_DELIVER_TIMEOUT_S = 10.0
_AGAIN_S = 0.1
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
        answer = self._insist(key, asked.encode(), _ASK_TIMEOUT_S, "an episode")
        return None if answer is None else Assignment.decode(answer)

    def deliver(self, episode: Episode) -> None:
        """Returns once the learner has taken the episode, has it already, or does not want it."""
        worker = self._worker
        which = f"episode ({episode.meta.iteration}, {episode.meta.episode})"
        answer = self._insist(
            keys.episode(worker.run), episode.encode(), _DELIVER_TIMEOUT_S, f"a receipt for {which}"
        )
        if answer is None:
            return
        worker.waiting.done()
        receipt = EpisodeReceipt.decode(answer)
        worker.counters.add(f"episodes_{receipt.verdict}")
        if receipt.verdict == "refused":
            worker.counters.refuse("episodes_not_wanted", f"{which}: {receipt.reason}")

    def _insist(self, key: str, body: bytes, timeout_s: float, what: str) -> bytes | None:
        worker = self._worker
        while not worker.stop.is_set():
            try:
                return request(worker.bus, key, body, timeout_s=timeout_s)
            except NoReplyError:
                worker.waiting.set(f"the learner to give {what}")
            except (RefusedError, MessageError) as error:
                worker.counters.refuse("requests_refused_by_learner", f"learner: {error}")
            worker.stop.wait(_AGAIN_S)
        return None
