"""One certificate that opens sessions without end: the others' services still get theirs."""

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from secure_router import SecureRouter, secure_router

from bpn_shared.bus.session import Bus
from bpn_shared.bus.session_shares import address_of, end_connection

SESSIONS = 12


@pytest.fixture(scope="module")
def small_router(
    tmp_path_factory: pytest.TempPathFactory, free_tcp_port: Callable[[], int]
) -> Iterator[SecureRouter]:
    """A router with certificates that takes twelve sessions."""

    def make_small(config: Any) -> None:
        config["transport"]["unicast"]["max_sessions"] = SESSIONS

    endpoint = f"tls/localhost:{free_tcp_port()}"
    with secure_router(tmp_path_factory.mktemp("certificates"), endpoint, make_small) as secured:
        yield secured


ATTACK = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from secure_router import SecureRouter
from bpn_shared.bus.session import BusError
router, opened = SecureRouter(sys.argv[1], Path(sys.argv[2])), []
while True:
    try:
        opened.append(router.open_as("robot_sim", deadline_s=1.0))
    except BusError:
        pass
    if len(opened) == 40:
        print("many", flush=True)
        time.sleep(600)
"""


def test_one_certificate_leaves_sessions_to_others(small_router: SecureRouter) -> None:
    support = str(Path(__file__).parent.parent / "support")
    with subprocess.Popen(
        [sys.executable, "-c", ATTACK, small_router.endpoint, str(small_router.certificates), support],
        stdout=subprocess.PIPE, text=True,
    ) as attacker:  # fmt: skip
        try:
            assert attacker.stdout is not None
            assert attacker.stdout.readline() == "many\n"
            opened: list[Bus] = []
            for role in ("edge", "learner", "dashboard", "edge"):
                opened.append(small_router.open_as(role, deadline_s=20.0))
            for bus in opened:
                assert bus.connected
                bus.close()
        finally:
            attacker.kill()


def test_a_share_is_for_use(small_router: SecureRouter) -> None:
    """Up to its share an identity has what it opens, and others have theirs beside it."""
    opened = [small_router.open_as("edge", deadline_s=20.0) for _ in range(SESSIONS // 2)]
    opened.append(small_router.open_as("learner", deadline_s=20.0))
    assert all(bus.connected for bus in opened)
    for bus in opened:
        bus.close()


@pytest.mark.parametrize(
    ("endpoint", "address"),
    [
        ("tls/127.0.0.1:7447", ("127.0.0.1", 7447)), ("tls/[::1]:7", ("::1", 7)),
        ("tcp/10.0.0.1:9?x=1", ("10.0.0.1", 9)), ("unixsock-stream//tmp/x", None), ("", None),
    ],
)  # fmt: skip
def test_addresses_of_endpoints(endpoint: str, address: tuple[str, int] | None) -> None:
    assert address_of(endpoint) == address


def test_only_the_connection_that_is_named_ends() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        clients = [socket.create_connection(listener.getsockname()) for _ in range(3)]
        accepted = [listener.accept()[0] for _ in range(3)]
        before = len(os.listdir("/dev/fd"))
        assert end_connection(clients[1].getsockname())
        assert not end_connection(("127.0.0.1", 1))
        assert len(os.listdir("/dev/fd")) == before
        assert clients[1].recv(1) == b""
        for index in (0, 2):
            accepted[index].sendall(b"x")
            assert clients[index].recv(1) == b"x"
        for connection in (*clients, *accepted):
            connection.close()
