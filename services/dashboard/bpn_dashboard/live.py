"""The parts that need the message bus: joined when the router is reached, and kept joined whatever is raised."""

import argparse
import asyncio
import logging
import math
import threading
import time
from collections.abc import AsyncIterator, Collection, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from bpn_dashboard.api.context import Context
from bpn_dashboard.api.models import Run
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.hub import presence
from bpn_dashboard.hub.hub import Hub
from bpn_dashboard.hub.topology import Topology
from bpn_dashboard.registry.dispatcher import Dispatcher
from bpn_dashboard.registry.election import MISSED_S, Candidate
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.backoff import Backoff
from bpn_shared.bus.router_watch import RouterWatch
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.messages.lease import LeaseRequest
from bpn_shared.runtime.service import new_worker_id
from bpn_shared.spec.config import ConfigError
from bpn_shared.waiting import WaitStatus

log = logging.getLogger(__name__)

_AGAIN_S, _AGAIN_AT_MOST_S = 1.0, 30.0
_JOINED_WITHIN_S = 2.0
"""A router that is there is reached sooner, and the election begun."""
_SETTLED_WITHIN_S = MISSED_S + 2.0
"""Who wants to change something waits at most so long for the election."""
_LOOKING = "looking whether another dashboard serves this router"


@dataclass
class Live:
    """What there is of it now; None while the router was not reached yet.

    Attributes:
        trouble: why it could not be joined, at the last try.
        joining_s: since when it is being joined, on the monotonic clock.
    """

    bus: Bus | None = None
    watch: RouterWatch | None = None
    hub: Hub | None = None
    dispatcher: Dispatcher | None = None
    candidate: Candidate | None = None
    topology: Topology = field(default_factory=Topology)
    trouble: str = ""
    joining_s: float = -math.inf
    _joined: threading.Condition = field(default_factory=threading.Condition)

    def obstacle(self) -> str | None:
        """What keeps workers from being given work; None: nothing."""
        if self.bus is None or self.dispatcher is None or self.candidate is None:
            return self.trouble or "the message bus is not reached yet"
        if not self.bus.connected:
            why = "" if (watch := self.watch) is None or not watch.why else f": {watch.why}"
            return f"the connection to the router at {self.bus.endpoint} is lost{why}"
        if not self.candidate.serves:
            return self.read_only() or _LOOKING
        trouble = self.dispatcher.trouble
        return None if trouble is None else f"the registry does not serve workers: {trouble}"

    def read_only(self) -> str | None:
        """Why nothing may be changed here; None: it may."""
        rival = None if (candidate := self.candidate) is None else candidate.rival
        return None if rival is None else str(rival)

    def undecided(self) -> bool:
        """Whether it has yet to be seen if another dashboard serves the router that is being joined, or was."""
        if (candidate := self.candidate) is None:
            return time.monotonic() - self.joining_s < _JOINED_WITHIN_S
        return not candidate.settled

    def refusal(self) -> str | None:
        """Why nothing may be changed here, when that is decided, for which it waits a few seconds; None: it may.

        Where no router is reached nobody else serves it: runs may be made, and wait for it.
        """
        deadline_s = time.monotonic() + _SETTLED_WITHIN_S
        while self.undecided() and (left_s := deadline_s - time.monotonic()) > 0:
            self._wait_decided(left_s)
        if (rival := self.read_only()) is not None:
            return rival
        return f"{self.obstacle() or _LOOKING}: try again" if self.undecided() else None

    def _wait_decided(self, timeout_s: float) -> None:
        """Waits for what may make the next look another one."""
        if (candidate := self.candidate) is not None:
            candidate.wait_settled(timeout_s)
            return
        joined_s = self.joining_s + _JOINED_WITHIN_S - time.monotonic()
        with self._joined:
            self._joined.wait_for(lambda: self.candidate is not None, min(timeout_s, joined_s))

    def take_part(self, candidate: Candidate) -> None:
        """Joined: who serves is decided from now on."""
        with self._joined:
            self.candidate = candidate
            self._joined.notify_all()

    def told(self) -> list[LeaseRequest]:
        """What the connected workers told of themselves when they asked for work."""
        return [] if self.dispatcher is None else self.dispatcher.desk.told()

    def refused(self) -> list[Refused]:
        """The workers that ask for work and cannot be used."""
        return [] if self.dispatcher is None else self.dispatcher.refused()

    def registry(self) -> RegistryView:
        """What the registry knows beside the rows."""
        return RegistryView() if self.dispatcher is None else self.dispatcher.view()

    def publish(self, rows: Sequence[RunRow]) -> None:
        """Tells the pages that are open."""
        if (hub := self.hub) is not None:
            for row in rows:
                hub.publish("runs", Run.of(row).model_dump(mode="json"))

    def publish_alert(self, alert: Mapping[str, Any]) -> None:
        """Tells them of something that somebody should hear of."""
        if (hub := self.hub) is not None:
            hub.publish("alerts", alert)

    def publish_gone(self, run_ids: Collection[str]) -> None:
        """Tells them which runs are not there any more."""
        if (hub := self.hub) is not None:
            for run_id in run_ids:
                hub.publish("runs", {"id": run_id, "removed": True})


async def stay_joined(
    options: argparse.Namespace, context: Context, live: Live, stop: threading.Event
) -> None:
    """Runs what needs the bus until `stop` is set; what is raised is said, and tried again after a pause."""
    backoff = Backoff(_AGAIN_S, _AGAIN_AT_MOST_S)
    while not stop.is_set():
        live.joining_s = time.monotonic()
        try:
            async with _joined(options, context, live, stop):
                live.trouble = ""
                backoff.reset()
                await asyncio.to_thread(stop.wait)
        except Exception as error:
            if stop.is_set() and isinstance(error, BusError):  # while it waited for the router
                log.info("%s", error)
                return
            expected = isinstance(error, BusError | ConfigError)
            trouble = str(error) if expected else f"{type(error).__name__}: {error}"
            trouble = f"the message bus cannot be used: {trouble}"
            if trouble != live.trouble:
                log.error("%s; trying again", trouble, exc_info=not expected)
            live.trouble = trouble
            await asyncio.to_thread(stop.wait, backoff.next_s())


@asynccontextmanager
async def _joined(
    options: argparse.Namespace, context: Context, live: Live, stop: threading.Event
) -> AsyncIterator[None]:
    """Waits for the router however long it takes; ends in the order in which nothing is missed."""
    async with AsyncExitStack() as stack:
        bus = await asyncio.to_thread(Bus, options.connect, deadline_s=float("inf"), stop=stop)
        stack.push_async_callback(asyncio.to_thread, bus.close)
        live.joining_s = time.monotonic()
        name = new_worker_id(presence.KIND)
        live.hub = Hub(bus, options.runs_dir, context.counters, name, live.topology)
        stack.callback(live.hub.close)
        waiting = WaitStatus()
        watch = RouterWatch(bus, waiting, context.counters, certificates=False)  # told elsewhere
        stack.push_async_callback(asyncio.to_thread, watch.close)
        present = presence.Presence(bus, name, context.counters, waiting)
        stack.push_async_callback(asyncio.to_thread, present.close)
        live.dispatcher = Dispatcher(
            bus, context.runs, context.counters, leading=False, read_only=live.read_only,
            why_lost=lambda: watch.why,
        )  # fmt: skip
        stack.push_async_callback(asyncio.to_thread, live.dispatcher.close)
        await asyncio.to_thread(live.dispatcher.start)
        candidate = Candidate(bus, name, live.dispatcher.lead, context.counters)
        stack.push_async_callback(asyncio.to_thread, candidate.close)
        live.take_part(candidate)
        live.bus, live.watch = bus, watch
        try:
            yield
        finally:
            live.bus = live.watch = live.hub = live.dispatcher = live.candidate = None
