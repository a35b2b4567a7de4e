"""Who looks at what: opens a topic's source for its first subscriber and closes it after its last."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bpn_dashboard.hub.channel import Channel
from bpn_dashboard.hub.client import Client, Transport
from bpn_dashboard.hub.sources import Close, sources
from bpn_dashboard.hub.topics import DELIVERY, Kind, Topic
from bpn_dashboard.hub.topology import Topology
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import TokenWatch
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.counters import Counters

PUBLISHED: tuple[Kind, ...] = ("runs", "alerts")
MAX_CLIENTS = 100
MAX_CLIENTS_OF_ONE = 40


class FullError(RuntimeError):
    """There are as many clients as the hub takes."""


@dataclass
class _Open:
    channel: Channel[Any]
    close: Close
    subscribers: int = 0
    end: asyncio.TimerHandle | None = None


class Hub:
    """The live view. Make it on the event loop; its methods but `publish` belong there.

    Args:
        name: of this life of the server: another one after a restart.
        counters: `live_refused`, `telemetry_refused`, `live_clients`, `live_clients_refused`.
        topology: is told who is alive and how.
    """

    def __init__(
        self, bus: Bus, runs_dir: Path, counters: Counters, name: str, topology: Topology
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._counters = counters
        self.name = name
        self._watches = (
            TelemetryWatch(bus, topology.hear, counters),
            TokenWatch(bus, keys.live("*", "*"), topology.token),
        )
        self._sources = sources(bus, runs_dir, topology, counters)
        self._open: dict[Topic, _Open] = {}
        self._clients: dict[Client, str] = {}  # with whose they are
        # Kept whether anyone looks or not.
        self._published = {name: self._acquire(Topic(name)) for name in PUBLISHED}

    def publish(self, topic: str, data: Mapping[str, Any]) -> None:
        """Publishes on a topic that has no source of its own, one of `PUBLISHED`. May be called on any thread.

        Raises:
            ValueError: another topic.
        """
        if topic not in self._published:
            raise ValueError(f"topic {topic!r} has a source of its own, and is not published")
        self._published[topic].put(data)

    def connect(self, transport: Transport, owner: str) -> Client:
        """A new client.

        Args:
            owner: whose it is; one has a share of all places.

        Raises:
            FullError: there are too many.
        """
        if len(self._clients) >= MAX_CLIENTS:
            self._counters.refuse("live_clients_refused", f"more than {MAX_CLIENTS} live clients")
            raise FullError(f"{MAX_CLIENTS} pages are connected, more are not taken")
        if list(self._clients.values()).count(owner) >= MAX_CLIENTS_OF_ONE:
            reason = f"more than {MAX_CLIENTS_OF_ONE} live clients of one session or token"
            self._counters.refuse("live_clients_refused", reason)
            raise FullError(f"{MAX_CLIENTS_OF_ONE} of your pages are connected, close one")
        client = Client(transport, lambda name: self._acquire(Topic.parse(name)), self._release)
        self._clients[client] = owner
        self._counters.add("live_clients")
        return client

    def disconnect(self, client: Client) -> None:
        """Forgets a client and what only it looked at."""
        client.close()
        self._clients.pop(client, None)

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    @property
    def open_topics(self) -> set[str]:
        """Topics whose source is open."""
        return {str(topic) for topic in self._open}

    def _acquire(self, topic: Topic) -> Channel[Any]:
        opened = self._open.get(topic)
        if opened is None:
            source = self._sources[topic.kind]
            kept = DELIVERY[topic.kind].kept
            channel: Channel[Any] = Channel(topic, kept, source.decode, self._loop)
            opened = self._open[topic] = _Open(channel, source.open(topic, channel.put))
        if opened.end is not None:
            opened.end.cancel()
            opened.end = None
        opened.subscribers += 1
        return opened.channel

    def _release(self, channel: Channel[Any]) -> None:
        opened = self._open[channel.topic]
        opened.subscribers -= 1
        if opened.subscribers:
            return
        linger_s = DELIVERY[channel.topic.kind].linger_s
        if linger_s:
            opened.end = self._loop.call_later(linger_s, self._end, channel.topic)
        else:
            self._end(channel.topic)

    def _end(self, topic: Topic) -> None:
        self._open.pop(topic).close()

    def close(self) -> None:
        """Ends all subscriptions to the bus."""
        for client in tuple(self._clients):
            self.disconnect(client)
        for opened in self._open.values():
            if opened.end is not None:
                opened.end.cancel()
            opened.close()
        self._open.clear()
        for watch in self._watches:
            watch.close()
