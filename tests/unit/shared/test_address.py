import pytest

from bpn_shared.bus.address import is_loopback, own_address
from bpn_shared.spec.config import ConfigError


@pytest.mark.parametrize(
    "endpoint",
    [
        "unixsock-stream//tmp/bpn-0123.sock",
        "tcp/127.0.0.1:7447",
        "tls/localhost:7447",
        "tcp/127.0.0.1:7447#iface=lo",
    ],
)
def test_with_a_router_on_this_machine_it_is_loopback(endpoint: str) -> None:
    assert own_address(endpoint) in ("127.0.0.1", "::1")


@pytest.mark.parametrize(
    ("endpoint", "match"),
    [
        ("tcp", "no host and port"),
        ("tcp/router", "no host and port"),
        ("tcp/no.such.invalid:1", "invalid"),
    ],
)
def test_an_endpoint_that_leads_nowhere_is_named(endpoint: str, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        own_address(endpoint)


@pytest.mark.parametrize(
    ("host", "expected"),
    [("localhost", True), ("127.0.0.1", True), ("127.9.9.9", True), ("::1", True),
     ("10.0.0.1", False), ("0.0.0.0", False), ("robots.example", False), ("", False)],
)  # fmt: skip
def test_loopback_is_told_from_the_rest(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
