"""Telling the learner that an episode cannot be had: it fails the run when it hears the same again and again."""

from bpn_shared.backoff import Backoff
from bpn_shared.bus import keys
from bpn_shared.bus.requests import NoReplyError, RefusedError, request
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import MAX_REASON, Fault, FaultReceipt
from bpn_shared.runtime.worker import Worker

_TIMEOUT_S = 2.0
_LONGEST_PAUSE_S = 10.0


class FaultReporter:
    """Tells of faults, one at a time.

    While nobody answers (a learner that knows no faults, or none), each call takes longer, so that whoever
    plays the same episode again does not do it without end and without a pause.
    """

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._backoff = Backoff(most_s=_LONGEST_PAUSE_S)

    def tell(self, iteration: int, episode: int, reason: str) -> bool:
        """Whether the learner knows it now.

        Args:
            reason: one sentence; equal faults have equal ones.
        """
        worker = self._worker
        fault = Fault(
            iteration=iteration, episode=episode, worker=worker.id, reason=reason[:MAX_REASON]
        )
        worker.counters.refuse("faults", f"episode ({iteration}, {episode}): {reason}")
        try:
            answer = request(
                worker.bus, keys.fault(worker.run), fault.encode(), timeout_s=_TIMEOUT_S
            )
            FaultReceipt.decode(answer)
        except (NoReplyError, RefusedError, MessageError) as error:
            worker.counters.refuse("faults_unanswered", f"the learner took no note: {error}")
            worker.stop.wait(self._backoff.next_s())
            return False
        self._backoff.reset()
        return True
