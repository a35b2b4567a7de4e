"""The edge's end of the two requests to its learner: what to play next, and here is an episode."""

from bpn_shared.backoff import Backoff
from bpn_shared.bus import keys
from bpn_shared.messages.control import Assignment, EpisodeReceipt, NextEpisode
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.runtime.worker import Worker

_DELIVER_TIMEOUT_S = 10.0
_LATEST_AGAIN_S = 5.0
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

    def reset(self) -> None:
        """There is news: the answer is probably another one soon."""
        self._pause_s = SOONEST_S


class LearnerLink:
    """Asks and delivers until the learner answers, however often it is restarted meanwhile.

    One episode may be in hand: played, and not delivered yet. So the next one is asked for and begun first, and
    the robot does not stand still while the learner writes to its disk.
    """

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._in_hand: tuple[EpisodeMeta, bytes] | None = None

    def next_episode(self, weights_version: int | None) -> Assignment | None:
        """What this slot shall play; None if the worker was stopped.

        Args:
            weights_version: the newest that is here; None: none.
        """
        worker = self._worker
        meta = self._in_hand[0] if self._in_hand else None
        asked = NextEpisode(
            slot=worker.slot,
            worker=worker.id,
            weights_version=weights_version,
            in_hand=(meta.iteration, meta.episode) if meta else None,
        )
        return worker.ask(
            keys.next_episode(worker.run),
            asked.encode(),
            Assignment.decode,
            waiting_for="the learner to give an episode",
            refused_as="requests_refused_by_learner",
        )

    def take_in_hand(self, episode: Episode) -> None:
        """Keeps an episode until `deliver`; nothing may be in hand.

        It is encoded here, before the robot begins the next one, whose frames would wait for it otherwise.
        """
        assert self._in_hand is None
        self._in_hand = episode.meta, episode.encode()

    def deliver(self) -> None:
        """Returns once the learner has taken what is in hand, has it already, or does not want it.

        What is wrong with the episode is in its receipt, and the learner counts it: it is played again. A request
        that is refused as such, as by a learner whose disk is full, is made again, and the reason shown.
        """
        if self._in_hand is None:
            return
        worker, (meta, encoded) = self._worker, self._in_hand
        which = f"episode ({meta.iteration}, {meta.episode})"
        receipt = worker.ask(
            keys.episode(worker.run),
            encoded,
            EpisodeReceipt.decode,
            waiting_for=f"the learner to give a receipt for {which}",
            refused_as="requests_refused_by_learner",
            on_refusal=self._show,
            timeout_s=_DELIVER_TIMEOUT_S,
            backoff=Backoff(most_s=_LATEST_AGAIN_S),
        )
        self._in_hand = None
        if receipt is None:  # the worker was stopped
            return
        worker.waiting.done()
        worker.counters.add(f"episodes_{receipt.status}")
        if receipt.status == "refused":
            worker.counters.refuse("episodes_not_wanted", f"{which}: {receipt.reason}")

    def _show(self, reason: str) -> None:
        self._worker.waiting.set(f"the learner, which refuses an episode now: {reason}")
        self._worker.counters.refuse("requests_refused_by_learner", f"learner: {reason}")
