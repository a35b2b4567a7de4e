"""Half-open connections, and clients that take nothing: a dashboard with few descriptors serves the others."""

import contextlib
import resource
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from bpn.dashboard import Dashboard
from bpn_certificates.authority import Validity, issue, new_authority
from bpn_dashboard.access.connections import Connections
from bpn_shared.counters import Counters
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

DESCRIPTORS = 1024
HALF_OPEN = 1100
REQUEST_HEAD = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-Slow: "


@pytest.fixture(autouse=True)
def _many_descriptors() -> Iterator[None]:
    """For the attacker: this test's own process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 4 * HALF_OPEN
    if hard != resource.RLIM_INFINITY and hard < wanted:
        pytest.fail(f"needs a limit of {wanted} open files, the hard limit is {hard}: ulimit -Hn")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextlib.contextmanager
def few_descriptors(
    runs_dir: Path, log: Path, wait_for, *options: str
) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """A dashboard that may open 1,024 files, and a client with its token."""

    with (
        log.open("w") as stderr,
        subprocess.Popen(
            ["sh", "-c", f'ulimit -n {DESCRIPTORS}; exec "$@"', "limited",
             sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(runs_dir), "--port", "0",
             "--connect", f"unixsock-stream/{runs_dir}/no-router", *options],
            stdout=subprocess.PIPE, stderr=stderr, text=True,
        ) as process,
    ):  # fmt: skip
        try:
            found: list[Dashboard] = []

            def answers() -> bool:
                found[:] = filter(None, [Dashboard.find(runs_dir)])
                return bool(found)

            wait_for(answers, "the dashboard to answer", 150)
            with contextlib.closing(found[0]._http) as client:
                yield process, client
            assert process.poll() is None
        finally:
            process.kill()


def connections(port: int, count: int, first_bytes: bytes, stack: contextlib.ExitStack):
    """So many connections that say this and no more."""
    made = []
    for _ in range(count):
        connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), 20))
        with contextlib.suppress(OSError):  # it was ended already
            connection.sendall(first_bytes)
        made.append(connection)
    return made


@pytest.mark.parametrize("first_bytes", [b"", REQUEST_HEAD, "body"])
def test_half_open_connections_keep_nobody_out(tmp_path, wait_for, first_bytes) -> None:
    if first_bytes == "body":
        first_bytes = (
            b"POST /api/v1/session HTTP/1.1\r\nHost: localhost\r\n"
            b"Content-Type: application/json\r\nContent-Length: 100000\r\n\r\n{"
        )
    runs_dir, log = tmp_path / "runs", tmp_path / "log"
    with (
        few_descriptors(runs_dir, log, wait_for) as (process, client),
        contextlib.ExitStack() as stack,
    ):
        port = httpx.URL(str(client.base_url)).port
        connections(port, HALF_OPEN, first_bytes, stack)
        for _ in range(10):
            began_s = time.monotonic()
            with httpx.Client(base_url=client.base_url, headers=client.headers) as other:
                assert other.get("/api/v1/runs", timeout=20).status_code == 200
                assert other.get("/api/v1/session", timeout=20).json()["role"] == "operator"
            assert time.monotonic() - began_s < 20
        open_files = len(list(Path(f"/proc/{process.pid}/fd").iterdir()))
        assert open_files < DESCRIPTORS - 100
    said = log.read_text()
    assert "connections_ended" in said
    assert len(said) < 100_000
    assert "Traceback" not in said


def test_half_agreed_tls_keeps_nobody_out(tmp_path, wait_for) -> None:
    validity = Validity.of_days(1)
    own = issue(new_authority("a", validity), "dashboard", validity, server_names=["localhost"])
    (tmp_path / "certificate.pem").write_bytes(own.certificate_pem())
    (tmp_path / "key.pem").write_bytes(own.key_pem())
    options = ["--certificate", str(tmp_path / "certificate.pem"), "--key", str(tmp_path / "key.pem"),
               "--allow-host", "localhost"]  # fmt: skip
    with (
        few_descriptors(tmp_path / "runs", tmp_path / "log", wait_for, *options) as (_, client),
        contextlib.ExitStack() as stack,
    ):
        port = httpx.URL(str(client.base_url)).port
        connections(port, HALF_OPEN, b"\x16\x03\x01", stack)
        context = ssl.create_default_context(cafile=str(tmp_path / "certificate.pem"))
        context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
        with httpx.Client(
            base_url=client.base_url, headers=client.headers, verify=context
        ) as other:
            assert other.get("/api/v1/runs", timeout=20).status_code == 200
    said = (tmp_path / "log").read_text()
    assert len(said) < 100_000


def test_a_request_that_does_not_come_to_its_end_is_ended(tmp_path, wait_for) -> None:
    """Byte by byte, so that the connection is never quiet."""
    with (
        few_descriptors(tmp_path / "runs", tmp_path / "log", wait_for) as (_, client),
        contextlib.ExitStack() as stack,
    ):
        port = httpx.URL(str(client.base_url)).port
        (slow,) = connections(port, 1, REQUEST_HEAD, stack)
        (again,) = connections(port, 1, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n", stack)
        assert again.recv(1000).startswith(b"HTTP/1.1 200")
        again.sendall(REQUEST_HEAD)  # a second request on a connection that was served

        def both_ended() -> bool:
            ended = 0
            for connection in (slow, again):
                try:
                    connection.sendall(b"x")
                except OSError:
                    ended += 1
            return ended == 2

        wait_for(both_ended, "the end of both", 150)


def test_a_client_that_takes_its_time_within_the_deadline_is_served(tmp_path, wait_for) -> None:
    RunFolder.create(
        tmp_path / "runs", "01a201f9-821b-74c6-95eb-3f4ab1331c4c", RunConfig.bare("reaching")
    )
    with (
        few_descriptors(tmp_path / "runs", tmp_path / "log", wait_for) as (_, client),
        contextlib.ExitStack() as stack,
    ):
        port = httpx.URL(str(client.base_url)).port
        (slow,) = connections(port, 1, REQUEST_HEAD, stack)
        assert client.get("/api/v1/runs").status_code == 200
        slow.sendall(b"yes\r\n\r\n")
        assert slow.recv(1000).startswith(b"HTTP/1.1 200")


class Peers:
    """Accepted sockets with made-up addresses."""

    def __init__(self, limit: int) -> None:
        self.counters = Counters()
        self.connections = Connections(self.counters, limit=limit, request_s=0.0)
        self.clients: list[socket.socket] = []
        self.port = 0

    def connect(self, address: str) -> tuple[str, int] | None:
        """The peer's address and port; None: it was refused."""
        client, accepted = socket.socketpair()
        self.clients.append(client)
        self.port += 1
        peer = (address, self.port)
        return None if self.connections.admit(accepted, peer) is None else peer


def test_the_oldest_of_whoever_has_most_makes_room() -> None:
    peers = Peers(limit=8)
    attacker = [peers.connect("10.0.0.66") for _ in range(3)]
    mine = peers.connect("10.0.0.1")
    assert peers.connect("10.0.0.66") is not None  # four wait: the oldest of the attacker's goes
    assert peers.clients[0].recv(1) == b""
    assert peers.counters.snapshot() == {"connections_ended": 1}
    peers.connections.request_is_whole(mine)
    served = [peers.connect("10.0.0.2") for _ in range(3)]
    for peer in (*served, mine, *attacker):
        peers.connections.request_is_whole(peer)
    assert peers.connect("10.0.0.3") is not None


def test_an_address_has_at_most_half() -> None:
    peers = Peers(limit=8)
    for _ in range(4):
        peers.connections.request_is_whole(peers.connect("10.0.0.1"))
    assert peers.connect("10.0.0.1") is None
    assert peers.connect("10.0.0.2") is not None


def test_late_requests_end_and_whole_ones_do_not() -> None:
    peers = Peers(limit=8)
    late, whole = peers.connect("10.0.0.1"), peers.connect("10.0.0.1")
    peers.connections.request_is_whole(whole)
    time.sleep(0.001)
    peers.connections.end_late()
    assert peers.clients[0].recv(1) == b""
    peers.clients[1].settimeout(0.05)
    with pytest.raises(TimeoutError):
        peers.clients[1].recv(1)
    peers.connections.wait_for_request(late)  # of one that is gone: nothing
    peers.connections.end_late()
    assert peers.counters.snapshot() == {"connections_ended": 1}
