"""Without certificates nothing can be reached from another machine."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from bpn_shared.bus.router import configure, endpoints, is_local
from bpn_shared.bus.router_config import render, secure
from bpn_shared.bus.session import DEFAULT_ENDPOINT, Bus
from bpn_shared.errors import InputError
from bpn_shared.spec.config import ConfigError

LOCAL = ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:1", "unixsock-stream//tmp/x.sock"]
OPEN = ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/router:7447", "ws/10.0.0.1:80", "udp/0.0.0.0:1"]


@pytest.mark.parametrize("endpoint", LOCAL)
def test_a_bare_router_listens_for_this_machine(endpoint: str) -> None:
    assert is_local(endpoint)
    assert endpoints(configure(endpoint)) == [endpoint]


@pytest.mark.parametrize("endpoint", [*OPEN, "tls/0.0.0.0:7447", "quic/[::]:7447"])
def test_a_bare_router_listens_for_nobody_else(endpoint: str) -> None:
    with pytest.raises(ConfigError, match="nobody would be asked who they are"):
        configure(endpoint)


@pytest.mark.parametrize("endpoint", OPEN)
def test_nor_does_one_with_certificates_where_they_are_not_asked_for(
    endpoint: str, tmp_path: Path
) -> None:
    file = tmp_path / "router.json5"
    file.write_text(render(secure()))
    assert endpoints(configure(None, file)) == ["tls/0.0.0.0:7447"]
    with pytest.raises(ConfigError):
        configure(endpoint, file)


def test_a_file_that_says_nothing_of_endpoints_does_not_open_zenohs_default(tmp_path: Path) -> None:
    file = tmp_path / "router.json5"
    file.write_text('{mode: "router"}')
    with pytest.raises(ConfigError, match="7447"):
        configure(None, file)


def test_what_is_no_endpoint_or_file_is_named(tmp_path: Path) -> None:
    damaged = tmp_path / "router.json5"
    damaged.write_text("{mode:")
    for file in (tmp_path / "none.json5", damaged):
        with pytest.raises(InputError, match=file.name):
            configure(None, file)
    for wrong in ("router", "tcp/127.0.0.1:70000"):
        with pytest.raises(InputError, match=wrong):
            configure(wrong)
        with pytest.raises(InputError, match=wrong):
            configure(None, upstream=wrong)


def test_router_and_services_listen_on_loopback_alone(
    free_tcp_endpoint: str, wait_for: Callable[..., None]
) -> None:
    router = subprocess.Popen(
        [sys.executable, "-m", "bpn_shared.bus.router", "--listen", free_tcp_endpoint]
    )
    try:
        with Bus(free_tcp_endpoint, deadline_s=10.0) as bus:
            wait_for(lambda: bus.connected, "the router")
            for process in (psutil.Process(router.pid), psutil.Process()):
                listening = [
                    connection.laddr.ip
                    for connection in process.net_connections()
                    if connection.status == psutil.CONN_LISTEN
                    or (connection.type == psutil.socket.SOCK_DGRAM)
                ]
                assert set(listening) <= {"127.0.0.1", "::1"}
        assert is_local(DEFAULT_ENDPOINT)
    finally:
        router.terminate()
        router.wait(10)
