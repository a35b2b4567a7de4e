"""Endpoints in Zenoh's form: where routers listen and their clients connect."""

import re
from typing import NamedTuple

from bpn_shared.errors import InputError

_NETWORK = re.compile(r"(?P<protocol>[a-z]+)/\[?(?P<host>[^\]]+?)\]?:(?P<port>[0-9]+)(?:[?#].*)?")
_PROTOCOLS = ("tcp", "tls", "quic", "ws", "udp")
_SOCKET_FILE = "unixsock-stream/"
_FORMS = "tcp/HOST:PORT, tls/HOST:PORT or unixsock-stream/PATH"


class Network(NamedTuple):
    """An endpoint that is reached by host and port."""

    protocol: str
    host: str
    port: int


def network(endpoint: str) -> Network | None:
    """Its parts; None if it has no host and port."""
    match = _NETWORK.fullmatch(endpoint)
    return None if match is None else Network(match[1], match[2], int(match[3]))


def check_endpoint(endpoint: str) -> None:
    """Refuses what no router can listen at.

    Raises:
        InputError: it is no endpoint; the message says what one is.
    """
    if endpoint.startswith(_SOCKET_FILE) and endpoint != _SOCKET_FILE:
        return
    parts = network(endpoint)
    if parts is None or parts.protocol not in _PROTOCOLS:
        raise InputError(f"{endpoint!r} is no endpoint of a router: give {_FORMS}")
    if parts.port > 65535:
        raise InputError(f"{endpoint!r}: port {parts.port} is above 65535")
