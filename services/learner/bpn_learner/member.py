"""A learner of rank 1 or above: takes its part in the run's updates and needs nothing but rank 0 for it."""

import contextlib
import logging

from bpn_learner.factory import initial_policy
from bpn_learner.group import GroupLostError
from bpn_learner.handout import receive_state
from bpn_learner.rendezvous import join
from bpn_learner.update import DivergenceError, UpdateConfig, UpdateStopped, fit
from bpn_shared.bus import keys
from bpn_shared.messages.rendezvous import RendezvousReply, RendezvousRequest
from bpn_shared.runtime.worker import EXIT_FINISHED, Worker, fetch_config
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import shuffle_generator

log = logging.getLogger(__name__)

_ASK_AGAIN_S = 0.1


def serve_member(worker: Worker) -> int:
    """Takes part in update after update until the worker is stopped.

    Raises:
        ConfigError: rank 0's configuration cannot be used here.
    """
    config = fetch_config(worker)
    if config is None:
        return EXIT_FINISHED
    member = _Member(worker, config)
    while (found := member.next_rendezvous()) is not None:
        try:
            member.update(found)
        except UpdateStopped:
            break
        except (GroupLostError, DivergenceError) as error:
            log.warning("gives up the update: %s", error)
    return EXIT_FINISHED


class _Member:
    def __init__(self, worker: Worker, config: RunConfig) -> None:
        self._worker, self._config = worker, config
        self._network, self._optimizer = initial_policy(config)

    def next_rendezvous(self) -> RendezvousReply | None:
        """Waits for rank 0 to begin an update; None if the worker was stopped."""
        worker = self._worker
        body = RendezvousRequest(rank=worker.slot, worker=worker.id).encode()
        key = keys.rendezvous(worker.run)
        while not worker.stop.is_set():
            reply = worker.ask(
                key,
                body,
                RendezvousReply.decode,
                waiting_for="the run's learner of rank 0",
                refused_as="rendezvous_refused",
            )
            if reply is None:
                break
            if reply.status == "meet":
                worker.waiting.done()
                return reply
            worker.waiting.set("the run's next update")
            worker.stop.wait(_ASK_AGAIN_S)
        return None

    def update(self, found: RendezvousReply) -> None:
        """Takes part in one update.

        Raises:
            GroupLostError, DivergenceError: it was given up.
            UpdateStopped: the worker was stopped.
        """
        with contextlib.closing(join(self._worker, found, self._config)) as group:
            regression, iteration = receive_state(group, self._network, self._optimizer)
            fit(
                self._network,
                self._optimizer,
                regression,
                UpdateConfig.of_iteration(self._config, iteration),
                shuffle_generator(self._config.seed, iteration),
                group=group,
                stop=self._worker.stop.is_set,
            )
        self._worker.counters.add("updates_shared")
        log.info("took part in the update of iteration %d", iteration)
