"""Addresses: which only this machine reaches, and under which others that use the same router reach it."""

import socket
from ipaddress import ip_address

from bpn_shared.bus.endpoint import network
from bpn_shared.spec.config import ConfigError

LOOPBACK = "127.0.0.1"


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches that address."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def own_address(endpoint: str) -> str:
    """The address from which this machine reaches the router at an endpoint, loopback if it runs here.

    So a service that others of its kind must reach listens where they are, and nowhere else.

    Raises:
        ConfigError: the endpoint names no host that can be resolved.
    """
    if endpoint.startswith("unixsock-stream/"):
        return LOOPBACK
    parts = network(endpoint)
    if parts is None:
        raise ConfigError(f"endpoint {endpoint!r} names no host and port")
    try:
        family, kind, protocol, _, router = socket.getaddrinfo(
            parts.host, parts.port, type=socket.SOCK_DGRAM
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.connect(router)  # of a datagram socket: nothing is sent, a route is chosen
            address: str = probe.getsockname()[0]
    except OSError as error:
        raise ConfigError(f"endpoint {endpoint!r}: {error}") from error
    return address
