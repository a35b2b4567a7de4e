"""Where workers ask for work: what tokens and requests tell of who works where, as several threads know it.

The lock is held for no file and no network: callbacks of tokens wait for it.
"""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple
from uuid import UUID

from pydantic import TypeAdapter

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.admission import admits
from bpn_dashboard.registry.circumstances import Queue, around
from bpn_dashboard.registry.leases import Demand, LeaseBook, Place
from bpn_dashboard.registry.losses import Loss, Losses
from bpn_dashboard.registry.setbacks import GiveBack, Setbacks
from bpn_dashboard.registry.versions import Refused, RefusedWorkers, why_refused, why_reported
from bpn_shared.bus import keys
from bpn_shared.bus.requests import RefusedError
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import LeaseReply, LeaseRequest, Role
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.watchdog import Circumstances
from bpn_shared.site import MAIN_SITE, site_of

log = logging.getLogger(__name__)

RETRY_S = 0.3
"""When an idle worker shall ask again."""
SETTLE_S = 1.5
"""After the router was reached: until then tokens may be on their way back."""
SERVED_S = 10.0
"""Who had a place for so long could use it."""
_ROLE: TypeAdapter[Role] = TypeAdapter(Role)


class Occupation(NamedTuple):
    """The runs at which somebody is, and those of them whose learner of rank 0 is there."""

    held: set[str]
    owned: set[str]


class LeaseDesk:
    """Knows who works where, and answers those who ask for work. Safe across threads.

    Args:
        folder: finds the folder of a run.
        news: called when something has changed.
        counters: refused tokens are counted here, and `learner_deaths`.
    """

    def __init__(
        self, folder: Callable[[str], RunFolder], news: Callable[[], None], counters: Counters
    ) -> None:
        self._folder, self._news, self._counters = folder, news, counters
        counters.add("learner_deaths", 0)  # what rises from nothing shall be seen to rise
        self._lock = threading.Lock()
        self._book, self._losses, self._setbacks = LeaseBook(), Losses(), Setbacks()
        self._refusals = RefusedWorkers()
        self._alive: set[str] = set()
        self._told: dict[str, LeaseRequest] = {}  # by connected workers, when they asked last
        self._iterations: dict[str, int] = {}  # of runs that are wanted
        self._given_up: dict[str, str] = {}
        self._router = ""

    # What the network tells

    def on_worker(self, key: str, appeared: bool) -> None:
        """A worker's token came or went."""
        role, worker = keys.worker_of(key)
        with self._lock:
            if appeared:
                self._alive.add(worker)
                self._refusals.appeared(role, worker, time.monotonic())
            else:
                self._alive.discard(worker)
                self._refusals.gone(worker)
                self._told.pop(worker, None)
                self._book.gone(worker)

    def on_lease(self, key: str, appeared: bool) -> None:
        """A lease's token came or went."""
        *_, run, role, slot, worker = key.split("/")
        try:
            place = Place(UUID(run), _ROLE.validate_python(role), int(slot))
        except ValueError:
            self._counters.refuse("tokens_refused", f"{key} is no lease's token")
            return
        now_s = time.monotonic()
        with self._lock:
            if appeared:
                self._book.appeared(place, worker, now_s)
            else:
                self._leave(place, worker, now_s)
        self._news()

    def _leave(self, place: Place, worker: str, now_s: float) -> None:
        if self._book.holder(place) == worker and self._book.held_s(place, now_s) > SERVED_S:
            self._setbacks.served(place)
        self._book.vanished(place, worker, now_s)
        if place.role == "learner":
            self._losses.lost(place.run, worker, now_s)

    def hear(self, report: Telemetry) -> None:
        """A worker tells how it is; one that was told its run by hand asks nobody for work."""
        if (reason := why_reported(report)) is not None:
            with self._lock:
                self._refusals.note(report.kind, report.worker, reason, time.monotonic())

    def on_router(self, router: str) -> None:
        """Which router is reached now: after another one, or none, tokens have to come back first."""
        with self._lock:
            if router != self._router:
                self._router = router
                self._book.quiet(time.monotonic() + SETTLE_S)
                self._losses.clear()  # it was the router that they lost

    def answer(self, body: bytes, site: str = MAIN_SITE) -> bytes:
        """Answers a worker that asks for work.

        Args:
            site: for which it asks, as the router let it.

        Raises:
            MessageError: it is no such question.
            RefusedError: the worker cannot be used here; the message says why.
        """
        asked = LeaseRequest.decode(body)
        now_s = time.monotonic()
        with self._lock:
            if (reason := why_refused(asked)) is not None:
                self._refusals.note(asked.role, asked.worker, reason, now_s)
                raise RefusedError(reason)
            if site_of(asked.worker) != site:
                raise RefusedError(f"{asked.worker} is no worker of site {site!r}")
            self._losses.heard_of(asked.worker)
            self._told[asked.worker] = asked
            places = self._book.candidates(asked.role, asked.worker, asked.label, now_s)
            self._take_back(asked, now_s)
            places = [p for p in places if self._may_offer(p, asked.worker, now_s)]
        for place in places:
            if self._grant(place, asked.worker):
                reply = LeaseReply(status="lease", run=str(place.run), slot=place.slot)
                return reply.encode()
        return LeaseReply(status="wait", retry_s=RETRY_S).encode()

    def told(self) -> list[LeaseRequest]:
        """What every connected worker that has asked for work told of itself then."""
        with self._lock:
            return list(self._told.values())

    def _grant(self, place: Place, worker: str) -> bool:
        with self._lock:
            led = self._book.is_confirmed(place.learner)
        if not admits(self._folder(str(place.run)), place, led=led):
            return False
        with self._lock:
            granted = self._book.grant(place, worker, time.monotonic())
        if granted:
            log.info("%s gets %s %d of run %s", worker, place.role, place.slot, place.run)
        return granted

    def _take_back(self, asked: LeaseRequest, now_s: float) -> None:
        """Notes that a worker could not use its last place."""
        back = asked.gave_back
        if back is None or back.run not in self._iterations:
            return
        place = Place(UUID(back.run), asked.role, back.slot)
        log.warning(
            "%s gave back %s %d of run %s: %s",
            asked.worker, place.role, place.slot, back.run, back.reason,
        )  # fmt: skip
        idle = self._book.idle(asked.role, now_s) | {asked.worker}
        noted = GiveBack(place, asked.worker, back.reason, self._iterations[back.run])
        give_up = self._setbacks.gave_back(noted, idle, now_s)
        if give_up is not None:
            self._given_up[back.run] = give_up
            self._news()

    def _may_offer(self, place: Place, worker: str, now_s: float) -> bool:
        if place.role == "learner" and self._losses.is_unnoted(place.run):
            return False  # another learner would bring the run on
        given_up = str(place.run) in self._given_up
        return not given_up and self._setbacks.may_try(place, worker, now_s)

    # For the dispatcher

    def vacancies(self) -> dict[Role, int]:
        """By role, the places in wanted runs that nobody has."""
        with self._lock:
            return dict(self._book.vacancies())

    def settle(self) -> None:
        """Gives no leases until all tokens should have been seen."""
        with self._lock:
            self._book.quiet(time.monotonic() + SETTLE_S)

    def demand(self, rows: Sequence[RunRow]) -> None:
        """Sets which runs are wanted, those to serve first first."""
        with self._lock:
            self._iterations = {row.id: row.iteration for row in rows}
            self._book.demand(
                [
                    Demand(UUID(row.id), row.config["robots"], row.config.get("learners", 1))
                    for row in rows
                    if row.id not in self._given_up
                ]
            )

    def occupation(self) -> Occupation:
        """Where somebody is."""
        with self._lock:
            runs = self._book.runs()
            owned = {str(r) for r in runs if self._book.is_confirmed(Place(r, "learner", 0))}
            return Occupation({str(run) for run in runs}, owned)

    def given_up(self) -> dict[str, str]:
        """The runs that shall fail, and why."""
        with self._lock:
            return dict(self._given_up)

    def unnoted(self) -> list[Loss]:
        """Learners that were lost, of which is to be noted how far their runs had come."""
        with self._lock:
            return self._losses.unnoted()

    def note(self, loss: Loss, iteration: int | None) -> None:
        """So many iterations were done when a learner was lost; None: the run was not running."""
        with self._lock:
            if iteration is None:
                self._losses.drop(loss)
            loss.iteration = iteration

    def count_deaths(self, now_s: float) -> None:
        """Gives up the runs whose learners die one after the other."""
        with self._lock:
            for loss in self._losses.deaths(now_s, self._alive):
                run = str(loss.run)
                if run not in self._iterations or loss.iteration is None:
                    continue  # the run is over, or was to stop
                log.warning("learner %s of run %s died", loss.worker, run)
                self._counters.add("learner_deaths")
                reason = self._setbacks.died(loss.run, loss.worker, loss.iteration)
                if reason is not None:
                    self._given_up[run] = reason

    def forget(self, run_id: str) -> None:
        """The run is over."""
        with self._lock:
            self._given_up.pop(run_id, None)
            self._setbacks.forget(UUID(run_id))

    def to_release(self, now_s: float) -> list[tuple[Place, str]]:
        """The leases that shall end."""
        with self._lock:
            return self._book.to_release(now_s)

    def refused(self) -> list[Refused]:
        """The workers that ask for work and cannot be used."""
        with self._lock:
            return self._refusals.current(time.monotonic())

    def alive(self) -> set[str]:
        """The workers that have a token."""
        with self._lock:
            return set(self._alive)

    def replaceable(self, now_s: float) -> list[tuple[Place, str]]:
        """The learners of rank 0 at work, if another one is idle."""
        with self._lock:
            if not self._book.idle("learner", now_s):
                return []
            places = [Place(run, "learner", 0) for run in self._book.runs()]
            confirmed = [place for place in places if self._book.is_confirmed(place)]
            return [(place, str(self._book.holder(place))) for place in confirmed]

    def depose(self, place: Place, worker: str) -> None:
        """Gives a learner's place free although its token is there: it does not answer."""
        with self._lock:
            if self._book.holder(place) == worker:
                self._book.depose(place, time.monotonic())

    def around(
        self, owners: dict[str, str | None], *, router: str, disk: str, read_only: str
    ) -> dict[str, Circumstances]:
        """What is known of runs that may stand still.

        Args:
            owners: of the runs asked for: who holds the folder although no worker of ours is its learner.
            router, disk, read_only: as `circumstances.around` takes them.
        """
        now_s = time.monotonic()
        with self._lock:
            refused, queue = self._refusals.current(now_s), Queue.of(self._book)
            return {
                run_id: around(
                    UUID(run_id), self._book, queue, self._setbacks,
                    refused=refused, now_s=now_s, owner=owner,
                    router=router, disk=disk, read_only=read_only,
                )
                for run_id, owner in owners.items()
            }  # fmt: skip
