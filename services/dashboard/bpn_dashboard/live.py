"""The parts that need the message bus: joined when the router is reached, and kept joined whatever is raised."""

import argparse
import asyncio
import logging
import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field

from bpn_dashboard.api.context import Context
from bpn_dashboard.api.models import Run
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.hub import presence
from bpn_dashboard.hub.hub import Hub
from bpn_dashboard.hub.topology import Topology
from bpn_dashboard.registry.dispatcher import Dispatcher
from bpn_dashboard.registry.election import Candidate
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.backoff import Backoff
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.runtime.service import new_worker_id
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)

_AGAIN_S, _AGAIN_AT_MOST_S = 1.0, 30.0


@dataclass
class Live:
    """What there is of it now; None while the router was not reached yet.

    Attributes:
        trouble: why it could not be joined, at the last try.
    """

    bus: Bus | None = None
    hub: Hub | None = None
    dispatcher: Dispatcher | None = None
    candidate: Candidate | None = None
    topology: Topology = field(default_factory=Topology)
    trouble: str = ""

    def obstacle(self) -> str | None:
        """What keeps workers from being given work; None: nothing."""
        if self.bus is None or self.dispatcher is None or self.candidate is None:
            return self.trouble or "the message bus is not reached yet"
        if not self.bus.connected:
            return f"the connection to the router at {self.bus.endpoint} is lost"
        if not self.candidate.serves:
            return self.read_only() or "looking whether another dashboard serves this router"
        return None if self.dispatcher.alive else "the registry does not serve workers"

    def read_only(self) -> str | None:
        """Why nothing may be changed here; None: it may."""
        rival = None if self.candidate is None else self.candidate.rival
        return None if rival is None else str(rival)

    def gpus(self) -> list[bool]:
        """Of the connected learners that have told, whether each has a GPU."""
        return [] if self.dispatcher is None else self.dispatcher.desk.gpus()

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


async def stay_joined(
    options: argparse.Namespace, context: Context, live: Live, stop: threading.Event
) -> None:
    """Runs what needs the bus until `stop` is set; what is raised is said, and tried again after a pause."""
    backoff = Backoff(_AGAIN_S, _AGAIN_AT_MOST_S)
    while not stop.is_set():
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
        name = new_worker_id(presence.KIND)
        live.hub = Hub(bus, options.runs_dir, context.counters, name, live.topology)
        stack.callback(live.hub.close)
        present = presence.Presence(bus, name, context.counters)
        stack.push_async_callback(asyncio.to_thread, present.close)
        live.dispatcher = Dispatcher(bus, context.runs, context.counters, leading=False)
        stack.push_async_callback(asyncio.to_thread, live.dispatcher.close)
        await asyncio.to_thread(live.dispatcher.start)
        live.candidate = Candidate(bus, name, live.dispatcher.lead)
        stack.push_async_callback(asyncio.to_thread, live.candidate.close)
        live.bus = bus
        try:
            yield
        finally:
            live.bus = live.hub = live.dispatcher = live.candidate = None
