import re

import pytest

from bpn_shared.bus.address import is_loopback, own_address
from bpn_shared.bus.endpoint import check_endpoint
from bpn_shared.bus.session import Bus
from bpn_shared.errors import InputError
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
    "endpoint",
    [
        "",
        "router",
        "tcp",
        "tcp/",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:70000",
        "http/a:1",
        "unixsock-stream/",
    ],
)
def test_what_is_no_endpoint_is_refused_and_not_waited_for(endpoint: str) -> None:
    for use in (check_endpoint, Bus):
        with pytest.raises(InputError, match=re.escape(repr(endpoint))):
            use(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tls/router:1",
        "tls/[::1]:65535",
        "tcp/a.b:1#iface=lo",
        "unixsock-stream//tmp/x",
    ],
)
def test_endpoints_of_every_form_are_taken(endpoint: str) -> None:
    check_endpoint(endpoint)


@pytest.mark.parametrize(
    ("host", "expected"),
    [("localhost", True), ("127.0.0.1", True), ("127.9.9.9", True), ("::1", True),
     ("10.0.0.1", False), ("0.0.0.0", False), ("robots.example", False), ("", False)],
)  # fmt: skip
def test_loopback_is_told_from_the_rest(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
