"""No certificate takes all of a router's sessions.

Zenoh limits the sessions of a router altogether, and not those of each certificate. But it tells who is at the end
of each link, and the links are sockets of this process: those beyond an identity's share are ended here.
"""

import contextlib
import os
import socket
import stat
import threading
from collections import defaultdict
from pathlib import Path

import zenoh

from bpn_shared.bus.declared import Declared
from bpn_shared.counters import Counters

_DESCRIPTORS = Path("/dev/fd")

Address = tuple[str, int]


class SessionShares(Declared):
    """Ends the newest links of whoever has more than its share, while the router's session lasts.

    Links without a certificate, as of a router of one machine, have no owner and no share.

    Args:
        session: the router's.
        share: links that one certificate's name may have.
        counters: `sessions_ended` is counted here.
    """

    def __init__(self, session: zenoh.Session, share: int, counters: Counters) -> None:
        super().__init__()
        self._share, self._counters = share, counters
        self._lock = threading.Lock()
        self._links: defaultdict[str, set[Address]] = defaultdict(set)
        self._keep(session.info.declare_link_events_listener(self._on_event, history=True))

    def _on_event(self, event: zenoh.LinkEvent) -> None:
        name, peer = event.link.auth_identifier, address_of(str(event.link.dst))
        if name is None or peer is None:
            return
        with self._lock:
            links = self._links[name]
            if event.kind == zenoh.SampleKind.DELETE:
                links.discard(peer)
                return
            links.add(peer)
            too_many = len(links) > self._share
        if too_many:
            reason = (
                f"{name} has {self._share} sessions, its share: one more from {peer[0]} was ended"
            )
            self._counters.refuse("sessions_ended", reason)
            end_connection(peer)


def address_of(endpoint: str) -> Address | None:
    """Host and port of an endpoint such as "tls/127.0.0.1:7447"; None if it has none."""
    host, _, port = endpoint.partition("/")[2].partition("?")[0].rpartition(":")
    return (host.strip("[]"), int(port)) if host and port.isdecimal() else None


def end_connection(peer: Address) -> bool:
    """Shuts down this process's connection with that address; whether there was one."""
    for name in os.listdir(_DESCRIPTORS):
        with contextlib.suppress(OSError):  # it was closed meanwhile, or has no peer
            if not stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                continue
            with socket.socket(fileno=os.dup(int(name))) as connection:
                if connection.getpeername()[:2] == peer:
                    connection.shutdown(socket.SHUT_RDWR)
                    return True
    return False
