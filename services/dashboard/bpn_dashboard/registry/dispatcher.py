"""The registry's rounds: keeps the rows what folders and tokens say, gives runs up, has workers let go.

Nothing here must survive: what is wanted stands in the database, who works where in the tokens.
"""

import logging
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.admission import recorded
from bpn_dashboard.registry.desk import LeaseDesk
from bpn_dashboard.registry.leases import Place
from bpn_dashboard.registry.observations import Changes
from bpn_dashboard.registry.observer import Observer
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.queue import queue_order
from bpn_dashboard.registry.releases import Releases
from bpn_dashboard.registry.stalls import Stalls
from bpn_dashboard.registry.states import is_busy
from bpn_dashboard.registry.store import RunStore, WhyNot
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import TokenWatch
from bpn_shared.bus.requests import NoReplyError, PatternResponder, RefusedError, request
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.counters import Counters
from bpn_shared.errors import one_line
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runs.state import OVER

log = logging.getLogger(__name__)

PERIOD_S = 0.25
ADOPT_S = 5.0
STALLS_S = 1.0
_NOT_OVER = ("queued", "running", "stopping", "stopped", "lost")
_PROBE_S, _PROBE_AGAIN_S = 2.0, 10.0
_SILENT_S = 45.0
"""A learner that says nothing for so long, though its token is there, loses its place to an idle one."""
_SERVED_WITHIN_S = 15.0
"""A round reads folders, which may be slow; longer, and something is wrong."""
_LEAST_FREE_BYTES = 64 * 1024 * 1024


class Dispatcher:
    """Serves workers from a thread of its own until it is closed.

    Args:
        counters: refused requests are counted here.
        leading: false: another registry serves this router; runs are watched, nothing is done to them.
        read_only: which one, as a sentence; None: none that is known.
        why_lost: the router is, where that is known; empty: it is not, or nobody can say why.

    Attributes:
        desk: what tokens and requests tell.
        stalls: which runs make no progress, and why.
    """

    def __init__(
        self, bus: Bus, store: RunStore, counters: Counters,
        *, leading: bool = True, read_only: WhyNot = lambda: None,
        why_lost: Callable[[], str] = str,
    ) -> None:  # fmt: skip
        self._bus, self._store, self._counters = bus, store, counters
        self._leading, self._read_only, self._why_lost = leading, read_only, why_lost
        self._lock = threading.Lock()
        self._changed: dict[str, RunRow] = {}
        self._news = threading.Event()
        self._closed = threading.Event()
        self.desk = LeaseDesk(store.folder, self._news.set, counters)
        self._rows: dict[str, RunRow] = {}  # of runs that are not over
        self._observers: dict[str, Observer] = {}
        self.stalls = Stalls()
        self._releases = Releases(bus, counters)
        self._probed_s: dict[str, float] = {}
        self._advanced_unix_s: dict[str, float] = {}
        self._adopt_at_s = self._stalls_at_s = 0.0
        self._served_s, self._trouble = time.monotonic(), ""
        self._thread = threading.Thread(target=self._run, name="dispatcher", daemon=True)

    def start(self) -> None:
        """Begins; workers get leases once the tokens of those that work already have been told."""
        self._store.audience.subscribe(self._take_changes)
        self._take_changes(self._store.find(RunFilter(states=_NOT_OVER, archived=None)))
        self.desk.on_router(self._bus.router)
        self._watches = (
            TokenWatch(self._bus, keys.live("*", "*"), self.desk.on_worker),
            TokenWatch(self._bus, keys.lease("*", "*", "*", "*"), self.desk.on_lease),
            TelemetryWatch(self._bus, self._hear, Counters()),  # the hub counts what is none
        )
        self._responder = self._respond() if self._leading else None
        self._thread.start()

    def _respond(self) -> PatternResponder:
        return PatternResponder(self._bus, keys.LEASE_REQUESTS, self._answer, self._counters)

    def _hear(self, report: Telemetry) -> None:
        self.stalls.hear(report)
        self.desk.hear(report)

    def _answer(self, key: str, body: bytes) -> bytes:
        self.desk.on_router(self._bus.router)
        return self.desk.answer(body, _site_asking(key))

    def lead(self, leading: bool) -> None:
        """Begins or ceases to serve workers."""
        if leading != self._leading:
            self.desk.settle()
            if not leading:
                self._leading = False
            responder, self._responder = self._responder, None
            if responder is not None:
                responder.close()
            if leading:
                self._responder = self._respond()
                self._leading = True  # not before: where that raised, it is tried again
            self._news.set()

    def close(self) -> None:
        """Ends the thread; workers go on with what they have."""
        self._store.audience.unsubscribe(self._take_changes)
        self._closed.set()
        self._news.set()
        if self._thread.is_alive():
            self._thread.join(10.0)
        self._releases.close()

    @property
    def trouble(self) -> str | None:
        """Why its rounds do not go on or succeed; None: they do."""
        if not self._thread.is_alive():
            return "its thread has ended"
        if time.monotonic() - self._served_s < _SERVED_WITHIN_S:
            return None
        return self._trouble or f"a round takes longer than {_SERVED_WITHIN_S:.0f} s"

    def refused(self) -> list[Refused]:
        """The workers that ask for work and cannot be used."""
        return self.desk.refused()

    def view(self) -> RegistryView:
        """What is known beside the rows."""
        return RegistryView(self.stalls.kinds(), self._advanced_unix_s, self.desk.vacancies())

    def _take_changes(self, rows: Sequence[RunRow]) -> None:
        with self._lock:
            _keep_newest(self._changed, rows)
        self._news.set()

    # On the dispatcher's thread

    def _run(self) -> None:
        while not self._closed.is_set():
            self._news.wait(PERIOD_S)
            self._news.clear()
            try:
                self._tick()
                self._served_s, self._trouble = time.monotonic(), ""
            except Exception as error:
                self._trouble = one_line(error)
                self._counters.fault("rounds_failed", "a round of the registry", error)
                self._closed.wait(PERIOD_S)

    def _tick(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._adopt_at_s:
            self._store.adopt()
            self._take_changes(self._store.changed_folders())
            self._forget_removed()
            self._adopt_at_s = now_s + ADOPT_S
        self.desk.on_router(self._bus.router)
        self._note_losses()
        self.desk.count_deaths(now_s)
        self._observe()
        if now_s >= self._stalls_at_s:
            self._observe_stalls(now_s)
            self._stalls_at_s = now_s + STALLS_S
        if self._leading:
            self._depose_silent(now_s)
            leases = self.desk.to_release(now_s)
            self._releases.tell((place, worker, self._reason(place)) for place, worker in leases)

    def _note_losses(self) -> None:
        """Writes down how far runs have come whose learners are gone, before others bring them on."""
        for loss in self.desk.unnoted():
            run_id = str(loss.run)
            state = recorded(self._store.folder(run_id))
            running = run_id in self._rows and state is not None and state.state == "running"
            self.desk.note(loss, self._observer(run_id).iteration() if running else None)

    def _observe(self) -> None:
        with self._lock:
            changed, self._changed = self._changed, {}
        _keep_newest(self._rows, changed.values())
        held, owned = self.desk.occupation()
        given_up = self.desk.given_up()
        busy = {run_id for run_id, row in self._rows.items() if is_busy(row.state)}
        seen = {}
        for run_id in changed.keys() | held | busy | given_up.keys():
            if (row := self._rows.get(run_id)) is not None:
                seen[run_id] = self._observer(run_id).columns(
                    row, owned=run_id in owned, give_up=given_up.get(run_id), record=self._leading
                )
        if self._store_seen(seen) or changed or given_up:
            for run_id in [run_id for run_id, row in self._rows.items() if row.state in OVER]:
                self._forget(run_id)
            self._demand()

    def _store_seen(self, seen: Mapping[str, Changes]) -> bool:
        """Stores the columns that have changed; whether any have."""
        news = {
            run_id: columns
            for run_id, columns in seen.items()
            if any(getattr(self._rows[run_id], key) != value for key, value in columns.items())
        }
        if news:
            _keep_newest(self._rows, self._store.observe(news))
        return bool(news)

    def _forget_removed(self) -> None:
        if removed := self._rows.keys() - self._store.ids():
            for run_id in removed:
                self._forget(run_id)
            self._demand()

    def _forget(self, run_id: str) -> None:
        del self._rows[run_id]
        self._observers.pop(run_id, None)
        self.stalls.forget(run_id)
        self.desk.forget(run_id)

    def _observer(self, run_id: str) -> Observer:
        if run_id not in self._observers:
            self._observers[run_id] = Observer(self._store.folder(run_id))
        return self._observers[run_id]

    def _demand(self) -> None:
        wanted = [
            row for row in self._rows.values()
            if row.desired_state == "running" and row.archived_at is None
        ]  # fmt: skip
        self.desk.demand(sorted(wanted, key=queue_order))

    def _observe_stalls(self, now_s: float) -> None:
        self.stalls.read()
        self._advanced_unix_s = {
            run_id: observer.advanced_unix_s for run_id, observer in self._observers.items()
        }
        # An owner whose token is gone may be frozen or cut off, and is spoken of as silent.
        owners = {observer.owner for observer in self._observers.values()}
        for worker in self.stalls.workers() - self.desk.alive() - owners:
            self.stalls.gone(worker)
        elsewhere = {
            run_id: observer.owner if (observer := self._observers.get(run_id)) is not None
            and observer.elsewhere else None for run_id in self._rows
        }  # fmt: skip
        known = self.desk.around(
            elsewhere, router=self._router(), disk=self._disk(), read_only=self._read_only() or ""
        )
        self._store_seen(
            {run: self.stalls.columns(self._rows[run], known[run], now_s) for run in known}
        )

    def _router(self) -> str:
        if self._bus.connected:
            return ""
        why = self._why_lost()
        return f"the router at {self._bus.endpoint} is not reached" + (f": {why}" if why else "")

    def _disk(self) -> str:
        try:
            free_bytes = shutil.disk_usage(self._store.runs_dir).free
        except OSError as error:
            return f"the folder of the runs cannot be looked at: {error.strerror}"
        if free_bytes >= _LEAST_FREE_BYTES:
            return ""
        return f"the disk of the runs is nearly full: {free_bytes // 2**20} MiB are left"

    def _depose_silent(self, now_s: float) -> None:
        """Gives up learners that have a token and say nothing, where another could take their place."""
        for place, worker in self.desk.replaceable(now_s):
            silent_s = self.stalls.silent_s(place.run, worker, now_s)
            if silent_s is None or silent_s < _SILENT_S or self._answers(worker, now_s):
                continue
            log.warning("learner %s of run %s is silent for %.0f s", worker, place.run, silent_s)
            self.desk.depose(place, worker)

    def _answers(self, worker: str, now_s: float) -> bool:
        """Whether a silent learner answers for its health; true as well if it was asked just now."""
        if now_s - self._probed_s.get(worker, -_PROBE_AGAIN_S) < _PROBE_AGAIN_S:
            return True
        probed = {name: t for name, t in self._probed_s.items() if now_s - t < _PROBE_AGAIN_S}
        self._probed_s = probed | {worker: now_s}
        try:
            request(self._bus, keys.health("learner", worker), b"", timeout_s=_PROBE_S)
        except (NoReplyError, RefusedError):
            return False
        return True

    def _reason(self, place: Place) -> str:
        row = self._rows.get(str(place.run))
        if row is None:
            return "the run is over"
        if row.desired_state == "stopped":
            return "the run shall stop"
        return self.desk.given_up().get(row.id, "it is needed elsewhere")


def _site_asking(key: str) -> str:
    """The site for which a worker asks at a key; empty: it names none, as those of earlier protocols."""
    return key.partition("/lease/")[2]


def _keep_newest(known: dict[str, RunRow], rows: Iterable[RunRow]) -> None:
    """Takes rows in, but none in place of one with later wishes: threads may tell in another order."""
    for row in rows:
        if row.id not in known or known[row.id].rev <= row.rev:
            known[row.id] = row
