"""A worker that goes from lease to lease, as the registry gives them.

The work of each lease has a session of its own, and the lease's token stands in it. When the lease ends the
session is closed, and every subscription, publication and token of that run goes with it: nothing is left
for the next run. While the registry is away, workers go on with what they have.
"""

import logging
import threading
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple
from uuid import UUID

from bpn_shared.backoff import Backoff
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import Token
from bpn_shared.bus.logs import LogPublisher
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.errors import InputError, one_line
from bpn_shared.messages.control import MAX_REASON
from bpn_shared.messages.lease import (
    MAX_PLUGIN_NAME,
    MAX_PLUGINS,
    GiveBack,
    LeaseReply,
    LeaseRequest,
    Release,
    ReleaseReply,
)
from bpn_shared.runs.folder import RunOwnedError
from bpn_shared.runtime.service import set_up_logging
from bpn_shared.runtime.worker import (
    EXIT_FINISHED,
    Worker,
    WorkerMain,
    WorkerProcess,
    WorkFailedError,
    service_name,
)
from bpn_shared.version import PROTOCOL, VERSION

log = logging.getLogger(__name__)

_GIVEN_BACK_S = 1.0
"""Pause before the next question after a lease that the worker could not use."""
_REFUSED_S, _REFUSED_AT_MOST_S = 1.0, 60.0
"""Pauses after refusals in a row: what refuses a worker seldom changes soon."""


class Abilities(NamedTuple):
    """What a worker can be used for.

    Attributes:
        gpu: whether it has one, if that is of interest.
        plugins: by entry-point group, the names of those that can be used there.
    """

    gpu: bool | None = None
    plugins: Mapping[str, Sequence[str]] = MappingProxyType({})

    def told(self) -> dict[str, tuple[str, ...]]:
        """The plug-ins, without groups that have more or longer names than a message takes."""
        return {
            group: tuple(names)
            for group, names in self.plugins.items()
            if len(names) <= MAX_PLUGINS and all(len(name) <= MAX_PLUGIN_NAME for name in names)
        }


UNTOLD = Abilities()


class Lease(NamedTuple):
    """A place, and what ends the work there."""

    run: UUID
    slot: int
    stop: threading.Event


class LeaseLoop:
    """Asks the registry for a place, works there until it is released, and asks again.

    Args:
        label: where this worker runs (`LeaseRequest`).
        abilities: what else the registry shall know.
    """

    def __init__(self, process: WorkerProcess, label: str, abilities: Abilities = UNTOLD) -> None:
        self._process, self._label, self._abilities = process, label, abilities
        self._lock = threading.Lock()
        self._lease: Lease | None = None
        self._gave_back: GiveBack | None = None  # until the registry knows
        self._refused = Backoff(_REFUSED_S, _REFUSED_AT_MOST_S)

    def run(self, serve: WorkerMain) -> int:
        """Works until the process is stopped."""
        process = self._process
        key = keys.control(process.kind, process.id)
        threading.Thread(target=self._pass_stop_on, name="stop", daemon=True).start()
        with (
            process.announced(self._place),
            Responder(process.bus, key, self._release, process.counters),
        ):
            while (lease := self._next()) is not None:
                self._work(lease, serve)
        return EXIT_FINISHED

    def _place(self) -> tuple[UUID | None, int | None]:
        lease = self._lease
        return (None, None) if lease is None else (lease.run, lease.slot)

    def _release(self, body: bytes) -> bytes:
        release = Release.decode(body)
        with self._lock:
            lease = self._lease
            working = lease is not None and str(lease.run) == release.run
            if lease is not None and working and not lease.stop.is_set():
                log.info("released from run %s: %s", release.run, release.reason)
                lease.stop.set()
        return ReleaseReply(working=working).encode()

    def _pass_stop_on(self) -> None:
        self._process.stop.wait()
        with self._lock:
            if self._lease is not None:
                self._lease.stop.set()

    def _next(self) -> Lease | None:
        """The next lease; None if the process was stopped."""
        process = self._process
        while not process.stop.is_set():
            asked = LeaseRequest(
                role=process.kind,
                worker=process.id,
                label=self._label,
                version=VERSION,
                protocol=PROTOCOL,
                gave_back=self._gave_back,
                gpu=self._abilities.gpu,
                plugins=self._abilities.told(),
            )
            reply = process.ask(
                keys.lease_request(process.site),
                asked.encode(),
                LeaseReply.decode,
                waiting_for="the registry to give work",
                refused_as="leases_refused",
                on_refusal=self._on_refusal,
            )
            if reply is None:
                break
            self._gave_back = None
            self._refused.reset()
            if reply.run_id is not None:
                process.waiting.done()
                return Lease(reply.run_id, reply.slot, threading.Event())
            process.waiting.set("work: no run needs this worker now")
            process.stop.wait(reply.retry_s)
        return None

    def _on_refusal(self, reason: str) -> None:
        process = self._process
        process.counters.refuse("leases_refused", f"asking the registry for work: {reason}")
        process.waiting.set(f"the registry, which refuses this worker: {reason}")
        process.stop.wait(self._refused.next_s())

    def _work(self, lease: Lease, serve: WorkerMain) -> None:
        process = self._process
        with self._lock:
            self._lease = lease
        if process.stop.is_set():  # since the registry was asked
            lease.stop.set()
        name = service_name(process.kind, lease.slot)
        set_up_logging(name)
        try:
            with (
                process.holding(lease.stop),
                Bus(process.bus.endpoint, stop=lease.stop, traffic=process.bus.traffic) as bus,
                Token(bus, keys.lease(lease.run, process.kind, lease.slot, process.id)),
                LogPublisher(bus, lease.run, name),
            ):
                log.info("%s serves run %s, slot %d", process.id, lease.run, lease.slot)
                _do(serve, process.at(lease.run, lease.slot, bus, lease.stop))
        except InputError as error:
            reason = str(error)[:MAX_REASON]
            self._gave_back = GiveBack(run=str(lease.run), slot=lease.slot, reason=reason)
            self._pause_after(lease, error)
        except (BusError, RunOwnedError) as error:  # no fault of the place
            self._pause_after(lease, error)
        finally:
            with self._lock:
                self._lease = None
            process.waiting.done()
            process.weights.forget()
            set_up_logging(process.kind)

    def _pause_after(self, lease: Lease, error: Exception) -> None:
        log.error("gives back the lease of run %s: %s", lease.run, error)
        self._process.stop.wait(_GIVEN_BACK_S)


def _do(serve: WorkerMain, worker: Worker) -> None:
    """Works; whatever goes wrong ends this lease alone.

    Raises:
        WorkFailedError: something that nobody foresaw.
    """
    try:
        serve(worker)
    except (BusError, InputError, RunOwnedError):
        raise
    except Exception as error:
        log.exception("%s", one_line(error))
        raise WorkFailedError(one_line(error)) from error
