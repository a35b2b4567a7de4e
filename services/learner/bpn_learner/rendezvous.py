"""Where a run's learners meet for one policy update, and how they are connected there.

Who has which rank, the registry or the supervisor says (a learner's slot). Where to meet, rank 0 says, over
the bus, to those of them that are there: certificates and access control are then the bus's, and a group
that has lost a member needs nobody else to form again.

A group lasts for one update. Between updates its members only ask for the next one, so who comes or goes
then disturbs nothing, and nobody keeps anything that could be stale.
"""

import contextlib
import logging
import os
import socket
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import torch
from torch.distributed import ProcessGroupGloo, TCPStore  # type: ignore[attr-defined]

from bpn_learner.group import DistributedGroup, GroupLostError, brief
from bpn_learner.update import UpdateStopped
from bpn_shared.bus import keys
from bpn_shared.bus.address import own_address
from bpn_shared.bus.requests import RefusedError, Responder
from bpn_shared.messages.rendezvous import RendezvousReply, RendezvousRequest
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig

log = logging.getLogger(__name__)

JOIN_TIMEOUT_S = 10.0
"""How long those who meet wait for each other's connections."""
SILENCE_S = 30.0
"""How long an exchange waits for a member that is there but silent: frozen for longer, it is given up."""
PRESENT_S = 2.0
"""Who has not asked for so long is not there; members ask several times a second."""


class Rendezvous:
    """Rank 0's end: answers the others, and gathers them for an update.

    Args:
        worker: the run's learner of rank 0.
    """

    def __init__(self, worker: Worker, config: RunConfig) -> None:
        self._worker, self._config, self._size = worker, config, config.learners
        self._address = own_address(worker.bus.endpoint)
        self._changed = threading.Condition()
        self._asked: dict[int, tuple[str, float]] = {}  # by rank: who, and when last
        self._reply: RendezvousReply | None = None
        self._responder = Responder(
            worker.bus, keys.rendezvous(worker.run), self._answer, worker.counters
        )

    def _answer(self, body: bytes) -> bytes:
        asked = RendezvousRequest.decode(body)
        if not 1 <= asked.rank < self._size:
            raise RefusedError(f"rank {asked.rank}: this run has learners 0..{self._size - 1}")
        now_s = time.monotonic()
        with self._changed:
            who, last_s = self._asked.get(asked.rank, (asked.worker, now_s))
            if who != asked.worker and now_s - last_s < PRESENT_S:
                return RendezvousReply(status="wait").encode()  # that rank is another one's
            self._asked[asked.rank] = asked.worker, now_s
            self._changed.notify_all()
            return (self._reply or RendezvousReply(status="wait")).encode()

    @contextlib.contextmanager
    def gathered(self) -> Iterator[DistributedGroup]:
        """The group of all learners, once they are there.

        Raises:
            GroupLostError: one that was there did not come.
            UpdateStopped: the worker was stopped meanwhile.
        """
        self._await_all()
        with socket.create_server((self._address, 0), family=_family(self._address)) as listening:
            port: int = listening.getsockname()[1]
            store = open_store(self._address, port, listening.detach())
        with self._changed:
            self._reply = RendezvousReply(status="meet", host=self._address, port=port)
        try:
            group = connect(store, self._address, 0, self._config)
        finally:
            with self._changed:
                self._reply = None
                self._asked.clear()  # who goes on with the next update will ask again
        with contextlib.closing(group):
            yield group

    def _await_all(self) -> None:
        waiting, stop = self._worker.waiting, self._worker.stop
        with self._changed:
            while missing := self._missing():
                if stop.is_set():
                    raise UpdateStopped(f"stopped while waiting for {missing}")
                waiting.set(missing)
                self._changed.wait(timeout=0.2)  # bounded, so that `stop` is seen
        waiting.done()

    def _missing(self) -> str:
        now_s = time.monotonic()
        there = {rank for rank, (_, last_s) in self._asked.items() if now_s - last_s < PRESENT_S}
        absent = sorted(set(range(1, self._size)) - there)
        ranks = ", ".join(str(rank) for rank in absent)
        return f"learner {ranks} of 0..{self._size - 1}" if absent else ""


def join(worker: Worker, found: RendezvousReply, config: RunConfig) -> DistributedGroup:
    """A member's end: connects it with the others that meet.

    Raises:
        GroupLostError: not all came in time, or they cannot be reached from here.
    """
    try:
        store = open_store(found.host, found.port)
    except RuntimeError as error:
        raise GroupLostError(f"{found.host} port {found.port}: {brief(error)}") from error
    return connect(store, own_address(worker.bus.endpoint), worker.slot, config)


def open_store(host: str, port: int, listening: int | None = None) -> TCPStore:
    """The store of torch at rank 0, through which members tell each other their addresses."""
    return TCPStore(
        host,
        port,
        is_master=listening is not None,
        timeout=timedelta(seconds=JOIN_TIMEOUT_S),
        wait_for_workers=False,
        master_listen_fd=listening,
    )


def connect(store: TCPStore, address: str, rank: int, config: RunConfig) -> DistributedGroup:
    size = config.learners
    try:
        backend = (_nccl if config.device == "cuda" else _gloo)(store, address, rank, size)
    except RuntimeError as error:
        raise GroupLostError(f"not all {size} learners came: {brief(error)}") from error
    return DistributedGroup(backend, rank, size)


def _gloo(store: TCPStore, address: str, rank: int, size: int) -> Any:
    options = ProcessGroupGloo._Options()  # type: ignore[attr-defined]  # torch's stubs: Options
    options._devices = [ProcessGroupGloo.create_device(hostname=address)]
    options._timeout = timedelta(seconds=JOIN_TIMEOUT_S)
    backend = ProcessGroupGloo(store, rank, size, options)
    backend._set_default_timeout(timedelta(seconds=SILENCE_S))
    return backend


def _nccl(store: TCPStore, _address: str, rank: int, size: int) -> Any:
    # Without it the watchdog ends the process when a member is lost, in place of an error.
    os.environ.setdefault("TORCH_NCCL_BLOCKING_WAIT", "1")
    options = torch.distributed.ProcessGroupNCCL.Options()
    options._timeout = timedelta(seconds=SILENCE_S)
    return torch.distributed.ProcessGroupNCCL(store, rank, size, options)


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address else socket.AF_INET
