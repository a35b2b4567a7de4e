"""Limits on connections: whoever says nothing, or takes nothing, makes room for others.

A connection costs a descriptor from the moment that it is accepted, long before there is a request, even where
TLS is not agreed on yet. So they are counted at the listening socket. Those that wait for a whole request are the
cheapest to end: the client is slow, or means harm. When there are too many, the oldest of whichever address has
most of them goes; a client that says what it wants is through long before it is the oldest.
"""

import asyncio
import errno
import logging
import resource
import socket
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Self

from bpn_shared.counters import Counters

log = logging.getLogger(__name__)

REQUEST_S = 20.0
"""How long a request may take to come, headers and body."""
SEND_S = 60.0
"""How long a client may take nothing of its answer."""
PERIOD_S = 1.0
_MAX_CONNECTIONS = 1024
_MAX_DESCRIPTORS = 65_536
BACKLOG = 32
"""How many are accepted at once, before anything else happens."""

Peer = tuple[Any, ...] | None
"""Address and port of a client, as ASGI's `client`; None where there is none, as on Unix sockets."""


class Connection(socket.socket):
    """One that was accepted; tells when it is closed."""

    peer: Peer
    registry: "Connections"

    @classmethod
    def of(cls, accepted: socket.socket, peer: Peer, registry: "Connections") -> Self:
        """Takes over an accepted socket's descriptor."""
        made = cls(accepted.family, accepted.type, accepted.proto, fileno=accepted.detach())
        made.peer, made.registry = peer, registry
        return made

    def close(self) -> None:
        """Closes it, and forgets it."""
        self.registry.forget(self)
        super().close()


class Connections:
    """All of one server. Belongs to its event loop.

    Args:
        limit: connections at a time; half of them may wait for a request, and half be of one address.
        request_s: how long a request may take to come.
        counters: `connections_ended` is counted here.
    """

    def __init__(
        self, counters: Counters, *, limit: int | None = None, request_s: float = REQUEST_S
    ) -> None:
        self._counters = counters
        self.limit = limit or min(_MAX_CONNECTIONS, _descriptors() // 2)
        self._request_s = request_s
        self._open: dict[Peer, Connection] = {}
        self._waiting_s: dict[Peer, float] = {}  # for a whole request, since when; oldest first
        self._of_address: Counter[Any] = Counter()

    def admit(self, accepted: socket.socket, peer: Peer) -> Connection | None:
        """Takes a connection in, if need be in place of another one; None: there is no room."""
        address, half = peer and peer[0], self.limit // 2
        if len(self._waiting_s) >= half or len(self._open) >= self.limit:
            waiting = Counter(other and other[0] for other in self._waiting_s)
            self._end_oldest(*(address for address, _ in waiting.most_common(1)))
        if self._of_address[address] >= half:
            self._end_oldest(address)
        if len(self._open) >= self.limit or self._of_address[address] >= half:
            self._counters.refuse(
                "connections_ended", f"{len(self._open)} connections: no more are taken"
            )
            accepted.close()
            return None
        connection = Connection.of(accepted, peer, self)
        self._open[peer] = connection
        self._of_address[address] += 1
        self.wait_for_request(peer)
        return connection

    def wait_for_request(self, peer: Peer) -> None:
        """From now on the connection's next request is awaited."""
        if peer in self._open:
            self._waiting_s.pop(peer, None)
            self._waiting_s[peer] = time.monotonic()

    def request_is_whole(self, peer: Peer) -> None:
        """All of the request has come."""
        self._waiting_s.pop(peer, None)

    def end(self, peer: Peer, reason: str) -> None:
        """Ends a connection, wherever its program stands."""
        connection = self._open.get(peer)
        if connection is not None:
            self._counters.refuse("connections_ended", f"a connection was ended: {reason}")
            self.forget(connection)
            with suppress(OSError):  # the client was faster
                connection.shutdown(socket.SHUT_RDWR)

    def forget(self, connection: Connection) -> None:
        """It is closed."""
        if self._open.get(connection.peer) is connection:
            del self._open[connection.peer]
            self._waiting_s.pop(connection.peer, None)
            address = connection.peer and connection.peer[0]
            self._of_address[address] -= 1
            if not self._of_address[address]:
                del self._of_address[address]

    def end_late(self) -> None:
        """Ends those whose request does not come."""
        latest_s = time.monotonic() - self._request_s
        for peer in [peer for peer, since_s in self._waiting_s.items() if since_s < latest_s]:
            self.end(peer, f"no whole request within {self._request_s:.0f} s")

    def _end_oldest(self, *addresses: Any) -> None:
        """Ends the one of these addresses that waits longest for its request."""
        for peer in self._waiting_s:
            if (peer and peer[0]) in addresses:
                self.end(peer, "too many wait for their requests")
                return

    async def watch(self) -> None:
        """Ends late ones until it is cancelled."""
        while True:
            await asyncio.sleep(PERIOD_S)
            self.end_late()

    @contextmanager
    def sending(self, peer: Peer) -> Iterator[None]:
        """While the body waits for the client to take something: not longer than a minute."""
        timer = asyncio.get_running_loop().call_later(
            SEND_S, self.end, peer, f"nothing was taken for {SEND_S:.0f} s"
        )
        try:
            yield
        finally:
            timer.cancel()


class Listener(socket.socket):
    """A listening socket whose connections are limited."""

    connections: Connections

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection that may stay."""
        while True:
            accepted, peer = super().accept()
            connection = self.connections.admit(accepted, peer and peer[:2])
            if connection is not None:
                return connection, peer


def raise_descriptor_limit() -> None:
    """Lets this process open as many files as the system lets it, within reason."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _MAX_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, _MAX_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def quiet_when_out_of_descriptors(loop: asyncio.AbstractEventLoop, counters: Counters) -> None:
    """Counts what asyncio would log once a second, with a traceback, while descriptors are used up."""

    def handle(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            counters.refuse("descriptors_used_up", f"no connection can be taken: {error.strerror}")
        else:
            loop.default_exception_handler(context)

    loop.set_exception_handler(handle)


def _descriptors() -> int:
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _MAX_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft
