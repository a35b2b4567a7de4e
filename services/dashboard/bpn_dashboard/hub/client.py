"""One browser tab: what it subscribed to, and what it is sent, at its own pace.

There is no queue: a subscription is a place in its topic, and the next message is made when the last one
was taken by the network. So a client that reads slowly, or not at all, costs what it costs to remember it.
"""

import asyncio
import math
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from bpn_dashboard.hub import protocol
from bpn_dashboard.hub.channel import CameraFrame, Channel, Item
from bpn_dashboard.hub.protocol import LiveFrame, ProtocolError, Subscribe
from bpn_dashboard.hub.topics import DELIVERY

MAX_SUBSCRIPTIONS = 64
_BATCH = 100
"""Messages of one topic in a row, so that a full one does not keep the others waiting."""


class Transport(Protocol):
    """Sends to the client; returns when the network has taken it."""

    async def send_text(self, data: str) -> None: ...

    async def send_bytes(self, data: bytes) -> None: ...


class Subscription:
    """A client's place in a topic."""

    def __init__(self, wanted: Subscribe, channel: Channel[Any]) -> None:
        delivery = DELIVERY[channel.topic.kind]
        self.id, self.channel = wanted.id, channel
        self.open = True
        self._newest_only = delivery.newest_only
        self._period_s = 1 / min(wanted.rate_hz or math.inf, delivery.rate_hz)
        self._due_s = 0.0
        self._unacknowledged: list[int] = []
        self._seq, self._gap_from_start = self._beginning(wanted.since)

    def _beginning(self, since: int | None) -> tuple[int, bool]:
        newest = self.channel.seq
        if self._newest_only:
            return 0, False  # what is there now, at once
        if since is None:
            return newest, False
        if since > newest:  # of an earlier life of the server
            return newest, True
        return since, False

    def acknowledge(self, seq: int) -> None:
        """The client is done with the frames up to `seq` (modulo 2**32)."""
        for index, sent in enumerate(self._unacknowledged):
            if sent & 0xFFFFFFFF == seq:
                del self._unacknowledged[: index + 1]
                return

    def due_s(self) -> float:
        """When it may send again if there is something to send (monotonic); never: infinity."""
        if self._gap_from_start:
            return 0.0
        if len(self._unacknowledged) >= protocol.CREDIT or self._seq >= self.channel.seq:
            return math.inf
        return self._due_s

    def take(self, now_s: float) -> Iterator[str | bytes]:
        """The messages to send now, one by one; whoever stops in between loses nothing but that."""
        if self.due_s() > now_s:
            return
        self._due_s = max(self._due_s + self._period_s, now_s)
        if self._gap_from_start:
            self._gap_from_start = False
            yield protocol.gap(self.id, None)
        if self._newest_only:
            yield from (self._message(item) for item in self.channel.after(self._seq, 1))
            return
        items = self.channel.after(self._seq, _BATCH)
        if len(items) == _BATCH:  # there may be more
            self._due_s = now_s
        for item in items:
            if item.seq > self._seq + 1:
                yield protocol.gap(self.id, item.seq - self._seq - 1)
            yield self._message(item)

    def _message(self, item: Item) -> str | bytes:
        self._seq = item.seq
        if not isinstance(item.content, CameraFrame):
            return protocol.data(self.id, item.seq, item.t_unix_s, item.content)
        self._unacknowledged.append(item.seq)
        frame = item.content
        return LiveFrame(
            subscription=self.id,
            seq=item.seq & 0xFFFFFFFF,
            t_capture_unix_s=frame.t_capture_unix_s,
            t_hub_unix_s=time.time(),
            channels=frame.channels,
            height_px=frame.height_px,
            width_px=frame.width_px,
            frames_stacked=frame.frames_stacked,
        ).encode(frame.pixels)


class Client:
    """One WebSocket's subscriptions. Belongs to the event loop."""

    def __init__(
        self,
        transport: Transport,
        open_channel: Callable[[str], Channel[Any]],
        close_channel: Callable[[Channel[Any]], None],
    ) -> None:
        self._transport = transport
        self._open_channel, self._close_channel = open_channel, close_channel
        self._subscriptions: dict[int, Subscription] = {}
        self._news = asyncio.Event()

    def subscribe(self, wanted: Subscribe) -> None:
        """Begins to send a topic.

        Raises:
            ProtocolError: the id is in use, the topic is unknown, or there are too many subscriptions.
        """
        if wanted.id in self._subscriptions:
            raise ProtocolError(f"id {wanted.id} is in use: unsub it, or take another", wanted.id)
        if len(self._subscriptions) >= MAX_SUBSCRIPTIONS:
            raise ProtocolError(f"more than {MAX_SUBSCRIPTIONS} subscriptions", wanted.id)
        try:
            channel = self._open_channel(wanted.topic)
        except ProtocolError as error:
            raise ProtocolError(str(error), wanted.id) from error
        channel.listen(self._news.set)
        self._subscriptions[wanted.id] = Subscription(wanted, channel)
        self._news.set()

    def unsubscribe(self, subscription_id: int) -> None:
        """Ends a subscription; of one that is not there nothing remains to be ended."""
        subscription = self._subscriptions.pop(subscription_id, None)
        if subscription is None:
            return
        subscription.open = False
        channel = subscription.channel
        if all(other.channel is not channel for other in self._subscriptions.values()):
            channel.unlisten(self._news.set)
        self._close_channel(channel)

    def acknowledge(self, subscription_id: int, seq: int) -> None:
        """Gives back the credit of frames; late ones, of a subscription that ended, are none."""
        subscription = self._subscriptions.get(subscription_id)
        if subscription is not None:
            subscription.acknowledge(seq)
            self._news.set()

    def close(self) -> None:
        """Ends all subscriptions."""
        for subscription_id in tuple(self._subscriptions):
            self.unsubscribe(subscription_id)

    async def send_forever(self) -> None:
        """Sends what comes, until cancelled or the transport raises."""
        loop = asyncio.get_running_loop()
        while True:
            self._news.clear()
            if await self._send_round():
                continue
            due_s = min((sub.due_s() for sub in self._subscriptions.values()), default=math.inf)
            alarm = None
            if due_s < math.inf:
                alarm = loop.call_later(max(0.0, due_s - time.monotonic()), self._news.set)
            await self._news.wait()
            if alarm is not None:
                alarm.cancel()

    async def _send_round(self) -> bool:
        sent = False
        for subscription in tuple(self._subscriptions.values()):
            for message in subscription.take(time.monotonic()):
                await self._send(message)
                sent = True
                if not subscription.open:
                    break
        return sent

    async def _send(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            await self._transport.send_bytes(message)
        else:
            await self._transport.send_text(message)
