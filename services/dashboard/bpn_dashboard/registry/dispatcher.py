"""The registry on the bus: gives leases, takes them back, and keeps the rows what the folders and tokens say.

Nothing here must survive: what is wanted stands in the database, who works where in the tokens.
"""

import logging
import threading
import time
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from uuid import UUID

from pydantic import TypeAdapter

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.crash_loops import CrashLoops
from bpn_dashboard.registry.leases import Demand, LeaseBook, Place
from bpn_dashboard.registry.observer import Observer
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.states import OVER, is_busy
from bpn_dashboard.registry.store import RunStore
from bpn_shared import keys
from bpn_shared.bus.liveliness import TokenWatch
from bpn_shared.bus.requests import NoReplyError, RefusedError, Responder, request
from bpn_shared.bus.session import Bus
from bpn_shared.config import ConfigError
from bpn_shared.messages.lease import LeaseReply, LeaseRequest, Release, Role
from bpn_shared.service import Counters

log = logging.getLogger(__name__)

PERIOD_S = 0.25
ADOPT_S = 5.0
RETRY_S = 0.3
"""When an idle worker shall ask again."""
SETTLE_S = 1.5
"""After the router was reached: until then tokens may be on their way back."""
SURELY_DEAD_S = 1.0
"""After a learner's lease has gone: whether it gave it back or died is then known."""
_ROLE: TypeAdapter[Role] = TypeAdapter(Role)
_NOT_OVER = ("queued", "running", "stopping", "stopped", "lost")
_RELEASE_TIMEOUT_S = 1.0
_RELEASE_AGAIN_S = 1.0
_SERVED_WITHIN_S = 15.0
"""A round waits at most a second for each worker that does not let go; longer, and something is wrong."""


class _Lost(NamedTuple):
    """A learner whose token went while its run was not over."""

    run: UUID
    worker: str
    at_s: float


class Dispatcher:
    """Serves workers from a thread of its own until it is closed.

    Args:
        counters: refused requests are counted here.
    """

    def __init__(self, bus: Bus, store: RunStore, counters: Counters) -> None:
        self._bus, self._store = bus, store
        self._lock = threading.Lock()  # of the book, the living and the lost, and what has changed
        self._book = LeaseBook()
        self._alive: set[str] = set()
        self._lost: list[_Lost] = []
        self._router = ""
        self._news = threading.Event()
        self._closed = threading.Event()
        self._changed: dict[str, RunRow] = {}
        self._rows: dict[str, RunRow] = {}  # of runs that are not over
        self._observers: dict[str, Observer] = {}
        self._released_s: dict[tuple[Place, str], float] = {}
        self._crash_loops = CrashLoops()
        self._given_up: dict[str, str] = {}
        self._adopt_at_s = 0.0
        self._served_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="dispatcher", daemon=True)
        self._counters = counters

    def start(self) -> None:
        """Begins; workers get leases once the tokens of those that work already have been told."""
        self._store.subscribe(self._take_changes)
        self._take_changes(self._store.find(RunFilter(states=_NOT_OVER, archived=None)))
        self._declared = (
            TokenWatch(self._bus, keys.live("*", "*"), self._on_worker),
            TokenWatch(self._bus, keys.lease("*", "*", "*", "*"), self._on_lease),
            Responder(self._bus, keys.lease_request(), self._on_request, self._counters),
        )
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; workers go on with what they have."""
        self._closed.set()
        self._news.set()
        if self._thread.is_alive():
            self._thread.join(10.0)

    @property
    def alive(self) -> bool:
        """Whether its rounds go on and succeed."""
        served = time.monotonic() - self._served_s < _SERVED_WITHIN_S
        return served and self._thread.is_alive()

    # On other threads

    def _take_changes(self, rows: Sequence[RunRow]) -> None:
        with self._lock:
            _keep_newest(self._changed, rows)
        self._news.set()

    def _on_worker(self, key: str, appeared: bool) -> None:
        _, worker = keys.worker_of(key)
        with self._lock:
            if appeared:
                self._alive.add(worker)
            else:
                self._alive.discard(worker)
                self._book.gone(worker)

    def _on_lease(self, key: str, appeared: bool) -> None:
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
                self._book.vanished(place, worker, now_s)
                if place.role == "learner" and self._recorded_state(place.run) == "running":
                    self._lost.append(_Lost(place.run, worker, now_s))
        self._news.set()

    def _on_request(self, body: bytes) -> bytes:
        asked = LeaseRequest.decode(body)
        now_s = time.monotonic()
        with self._lock:
            self._check_router(now_s)
            place = self._book.ask(asked.role, asked.worker, asked.label, now_s, self._admits)
        if place is None:
            return LeaseReply(verdict="wait", retry_s=RETRY_S).encode()
        log.info("%s gets %s %d of run %s", asked.worker, place.role, place.slot, place.run)
        return LeaseReply(verdict="lease", run=str(place.run), slot=place.slot).encode()

    def _admits(self, place: Place) -> bool:
        """Whether the run may be worked on, as its folder says now."""
        state = self._recorded_state(place.run)
        if state is None or state in OVER:
            return False
        if place.role != "learner" or not self._store.folder(str(place.run)).is_owned():
            return True
        # Its owner is a worker of ours that wants others beside it, or else somebody of whom we know nothing.
        return place != place.learner and self._book.holder(place.learner) is not None

    def _recorded_state(self, run: UUID) -> str | None:
        try:
            return self._store.folder(str(run)).state().state
        except ConfigError:
            return None

    def _check_router(self, now_s: float) -> None:
        router = self._bus.router
        if router != self._router:
            self._router = router
            self._book.quiet(now_s + SETTLE_S)
            self._lost.clear()  # it was the router that they lost

    # On the dispatcher's thread

    def _run(self) -> None:
        while not self._closed.is_set():
            self._news.wait(PERIOD_S)
            self._news.clear()
            try:
                self._tick()
                self._served_s = time.monotonic()
            except Exception:
                log.exception("the registry's round failed, and is tried again")
                self._closed.wait(PERIOD_S)

    def _tick(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._adopt_at_s:
            self._store.adopt()
            self._take_changes(self._store.changed_folders())
            self._adopt_at_s = now_s + ADOPT_S
        self._count_deaths(now_s)
        self._observe()
        self._release(now_s)

    def _observe(self) -> None:
        with self._lock:
            changed, self._changed = self._changed, {}
            self._check_router(time.monotonic())
            held = {str(run) for run in self._book.runs()}
            owned = {
                run_id for run_id in held
                if self._book.is_confirmed(Place(UUID(run_id), "learner", 0))
            }  # fmt: skip
        _keep_newest(self._rows, changed.values())
        busy = {run_id for run_id, row in self._rows.items() if is_busy(row.state)}
        seen = {}
        for run_id in changed.keys() | held | busy | self._given_up.keys():
            if (row := self._rows.get(run_id)) is not None:
                columns = self._observer(run_id).columns(
                    row, owned=run_id in owned, give_up=self._given_up.get(run_id)
                )
                if any(getattr(row, key) != value for key, value in columns.items()):
                    seen[run_id] = columns
        if seen:
            _keep_newest(self._rows, self._store.observe(seen))
        if changed or seen:
            for run_id in [run_id for run_id, row in self._rows.items() if row.state in OVER]:
                self._forget(run_id)
            self._demand()

    def _forget(self, run_id: str) -> None:
        del self._rows[run_id]
        self._observers.pop(run_id, None)
        self._given_up.pop(run_id, None)
        self._crash_loops.forget(UUID(run_id))

    def _observer(self, run_id: str) -> Observer:
        if run_id not in self._observers:
            self._observers[run_id] = Observer(self._store.folder(run_id))
        return self._observers[run_id]

    def _demand(self) -> None:
        wanted = [
            row for row in self._rows.values()
            if row.desired_state == "running" and row.archived_at is None
            and row.id not in self._given_up
        ]  # fmt: skip
        wanted.sort(key=lambda row: (row.created_at, row.id))
        with self._lock:
            self._book.demand(
                [
                    Demand(UUID(row.id), row.config["robots"], row.config.get("learners", 1))
                    for row in wanted
                ]
            )

    def _count_deaths(self, now_s: float) -> None:
        with self._lock:
            due = [lost for lost in self._lost if now_s - lost.at_s > SURELY_DEAD_S]
            self._lost = [lost for lost in self._lost if lost not in due]
            alive = set(self._alive) if due else set()
        for lost in due:
            row = self._rows.get(str(lost.run))
            if lost.worker in alive or row is None or row.desired_state == "stopped":
                continue  # it gave the run back, or the run is over
            log.warning("learner %s of run %s died", lost.worker, lost.run)
            reason = self._crash_loops.died(lost.run, lost.worker, row.iteration)
            if reason is not None:
                self._given_up[row.id] = reason
                self._demand()

    def _release(self, now_s: float) -> None:
        with self._lock:
            leases = self._book.to_release(now_s)
        self._released_s = {key: t for key, t in self._released_s.items() if key in leases}
        for place, worker in leases:
            if now_s - self._released_s.get((place, worker), -_RELEASE_AGAIN_S) < _RELEASE_AGAIN_S:
                continue
            self._released_s[place, worker] = now_s
            body = Release(run=str(place.run), reason=self._reason(place)).encode()
            key = keys.control(place.role, worker)
            try:
                request(self._bus, key, body, timeout_s=_RELEASE_TIMEOUT_S)
            except (NoReplyError, RefusedError) as error:
                log.warning("%s does not let go of run %s: %s", worker, place.run, error)

    def _reason(self, place: Place) -> str:
        row = self._rows.get(str(place.run))
        if row is None:
            return "the run is over"
        if row.desired_state == "stopped":
            return "the run shall stop"
        return self._given_up.get(row.id, "it is needed elsewhere")


def _keep_newest(known: dict[str, RunRow], rows: Iterable[RunRow]) -> None:
    """Takes rows in, but none in place of one with later wishes: threads may tell in another order."""
    for row in rows:
        if row.id not in known or known[row.id].rev <= row.rev:
            known[row.id] = row
