"""What goes past the router between two processes of one machine, and when nothing does."""

import contextlib
import os
import resource
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bus import local_socket
from bpn_shared.bus.liveliness import Token
from bpn_shared.bus.local_link import MAX_CONNECTIONS, LocalClient, LocalServer
from bpn_shared.bus.local_socket import LocalConnection
from bpn_shared.bus.session import Bus
from bpn_shared.bus.traffic import Tally

OpenBus = Callable[[], Bus]
WaitFor = Callable[..., None]
HEADER, LARGEST = 8, 8 + 70_000


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Sockets are in a folder of the test's own; its path is short, as those of sockets have to be."""
    with tempfile.TemporaryDirectory(prefix="bpn") as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        yield Path(folder)


class Robot:
    """The robot's end, and what it heard."""

    def __init__(self, bus: Bus) -> None:
        self.heard: list[bytes] = []
        self.lost = 0
        self.end = LocalServer(
            bus, "test/local/{}".format, "test/frame", "test/action", attachment_bytes=0, max_bytes=32,
            on_message=lambda _attachment, payload, _t_ns: self.heard.append(payload), on_lost=self._lose,
        )  # fmt: skip

    def _lose(self) -> None:
        self.lost += 1


class Edge:
    """The edge's end, which answers each message with its attachment."""

    def __init__(self, bus: Bus) -> None:
        self.heard: list[tuple[bytes, bytes]] = []
        self.connections: list[LocalConnection] = []
        self.end = LocalClient(
            bus, "test/local/*", "test/frame", attachment_bytes=HEADER, max_bytes=LARGEST, on_message=self._take
        )  # fmt: skip

    def _take(
        self, connection: LocalConnection, attachment: bytes, payload: bytes, _t_ns: int
    ) -> None:
        self.heard.append((attachment, payload))
        self.connections.append(connection)
        connection.put(b"", attachment)


@pytest.fixture
def robot(open_bus: OpenBus) -> Iterator[Robot]:
    robot = Robot(open_bus())
    yield robot
    robot.end.close()


@pytest.fixture
def edge(open_bus: OpenBus) -> Iterator[Edge]:
    edge = Edge(open_bus())
    yield edge
    edge.end.close()


def reached(robot: Robot, payload: bytes = b"pixels") -> bool:
    return robot.end.put(b"01234567", payload)


def test_what_one_end_sends_comes_whole_at_the_other_and_is_counted(
    robot: Robot, edge: Edge, wait_for: WaitFor
) -> None:
    wait_for(lambda: reached(robot), "the edge to be connected")
    wait_for(lambda: robot.heard == [b"01234567"], "the answer")
    assert edge.heard == [(b"01234567", b"pixels")]
    assert robot.end.put(b"76543210", bytes(70_000))
    wait_for(lambda: len(robot.heard) == 2, "the answer to a large one")
    assert edge.heard[1] == (b"76543210", bytes(70_000))


def test_one_that_is_connected_late_is_reached_and_one_that_leaves_is_missed(
    open_bus: OpenBus, robot: Robot, wait_for: WaitFor
) -> None:
    assert not reached(robot)
    edge = Edge(open_bus())
    wait_for(lambda: reached(robot), "the edge to be connected")
    edge.end.close()
    wait_for(lambda: robot.lost == 1, "the robot to notice")
    assert not reached(robot)


def test_a_connection_that_breaks_is_made_again(
    robot: Robot, edge: Edge, wait_for: WaitFor
) -> None:
    wait_for(lambda: reached(robot), "the edge to be connected")
    wait_for(lambda: edge.connections, "a message")
    edge.connections[0].close()
    wait_for(lambda: robot.lost == 1, "the robot to notice")
    wait_for(lambda: reached(robot), "another connection")


def test_the_session_that_tells_of_it_may_end_and_it_goes_on(
    open_bus: OpenBus, edge: Edge, wait_for: WaitFor
) -> None:
    """As when the router dies: the offer goes with it, the connection stays."""
    bus = open_bus()
    robot = Robot(bus)
    wait_for(lambda: reached(robot), "the edge to be connected")
    assert robot.end._token is not None
    robot.end._token.close()
    wait_for(lambda: not edge.end._offers, "the edge to hear of it")
    before = len(edge.heard)
    assert reached(robot)
    wait_for(lambda: len(edge.heard) > before, "the message")
    robot.end.close()


@pytest.mark.usefixtures("edge")
def test_a_robot_that_begins_is_no_edge_of_the_others(
    open_bus: OpenBus, robot: Robot, wait_for: WaitFor, caplog: pytest.LogCaptureFixture
) -> None:
    """It looks whose sockets are left over; what was sent to a robot's edge is not sent again for that."""
    caplog.set_level("INFO")
    wait_for(lambda: reached(robot), "the edge to be connected")
    others = [Robot(open_bus()) for _ in range(3)]
    wait_for(lambda: all(map(reached, others)), "the edge to be connected with all")
    assert robot.lost == 0
    for other in others:
        other.end.close()
    assert caplog.text.count("an edge of this machine is reached") <= 4


def test_an_offer_that_is_made_again_makes_no_second_connection(
    open_bus: OpenBus, edge: Edge, wait_for: WaitFor
) -> None:
    """As when the router is back: every frame would be sent, and answered, once more for each time."""
    bus = open_bus()
    robot = Robot(bus)
    wait_for(lambda: reached(robot), "the edge to be connected")
    token = robot.end._token
    assert token is not None
    for _ in range(MAX_CONNECTIONS):
        token.close()
        wait_for(lambda: not edge.end._offers, "the edge to hear that it is gone")
        token = Token(bus, f"test/local/{robot.end._path.name}")
        wait_for(lambda: edge.end._offers, "the edge to hear of it")
    (offer,) = edge.end._offers.values()
    assert not offer.is_set()
    assert len(robot.end._connections) == 1
    edge.connections[0].close()
    wait_for(lambda: robot.lost == 1, "the robot to notice")
    wait_for(lambda: reached(robot), "another connection while the offer stands")
    assert len(robot.end._connections) == 1
    token.close()
    robot.end.close()


def test_a_robot_that_is_out_of_descriptors_for_a_moment_takes_edges_in_later(
    robot: Robot, wait_for: WaitFor, caplog: pytest.LogCaptureFixture
) -> None:
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as late:
        free = os.dup(late.fileno())
        os.close(free)
        usual = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (free, most))
        try:
            late.connect(str(robot.end._path))
            wait_for(lambda: "no edge is taken in past the router" in caplog.text, "the failure")
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, usual)
        wait_for(lambda: reached(robot), "the edge to be taken in")


def test_an_edge_does_not_wait_for_a_robot_that_takes_nobody_in(own_folder: Path) -> None:
    listener, path = local_socket.listen()
    assert path.is_relative_to(own_folder)

    def connect_many(connected: contextlib.ExitStack) -> None:
        for _ in range(100):
            connected.enter_context(local_socket.connect(path.name))

    with listener, contextlib.ExitStack() as connected, pytest.raises(BlockingIOError):
        connect_many(connected)


def test_an_end_that_reads_nothing_costs_no_time_and_is_told(
    robot: Robot, wait_for: WaitFor
) -> None:
    with local_socket.connect(robot.end._path.name):
        wait_for(lambda: reached(robot), "the connection")
        for _ in range(1000):  # the kernel keeps some; it never blocks
            if not reached(robot, bytes(60_000)):
                break
        else:
            pytest.fail("a thousand messages of 60 KB were taken that nobody reads")
    wait_for(lambda: robot.lost == 1, "the robot to notice")


@given(st.one_of(st.binary(max_size=HEADER - 1), st.just(bytes(LARGEST + 1))))
def test_what_is_too_short_or_too_long_ends_the_connection(message: bytes) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        connection = LocalConnection(ours, HEADER, LARGEST)
        theirs.send(message)
        connection.receive(lambda *_: pytest.fail("it was taken"), Tally())
        connection.close()
        assert theirs.recv(1) == b""


def test_only_so_many_are_served(robot: Robot, wait_for: WaitFor) -> None:
    ends = [local_socket.connect(robot.end._path.name) for _ in range(MAX_CONNECTIONS)]
    wait_for(lambda: len(robot.end._connections) == MAX_CONNECTIONS, "all of them")
    with local_socket.connect(robot.end._path.name) as surplus:
        assert surplus.recv(1) == b""
    for end in ends:
        end.close()
    wait_for(lambda: not robot.end._connections, "their ends to be noticed")


def test_a_socket_whose_process_died_is_removed_and_others_are_kept() -> None:
    first, kept = local_socket.listen()
    second, dead = local_socket.listen()
    second.close()
    third, new = local_socket.listen()
    assert {path.name for path in local_socket.directory().iterdir()} == {kept.name, new.name}
    assert not dead.exists()
    first.close()
    third.close()


def test_the_folder_is_the_users_alone(own_folder: Path) -> None:
    folder = local_socket.directory()
    assert folder == own_folder / f"bpn-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("spoil", [
    lambda folder: folder.mkdir(mode=0o755),
    lambda folder: folder.symlink_to("/tmp"),
    lambda folder: folder.write_text(""),
])  # fmt: skip
def test_a_folder_that_others_may_enter_is_not_used(
    own_folder: Path, spoil: Callable[[Path], object], open_bus: OpenBus
) -> None:
    spoil(own_folder / f"bpn-{os.getuid()}")
    with pytest.raises(OSError, match=f"bpn-{os.getuid()}"):
        local_socket.listen()
    with pytest.raises(OSError, match=f"bpn-{os.getuid()}"):
        local_socket.connect("any.sock")
    robot = Robot(open_bus())  # goes on by the router
    assert not reached(robot)
    robot.end.close()


def test_a_process_of_another_user_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    local_socket.check_peer(ours)
    monkeypatch.setattr(local_socket.os, "getuid", lambda: os.geteuid() + 1)
    with pytest.raises(PermissionError, match="at the other end is user"):
        local_socket.check_peer(ours)
    ours.close()
    theirs.close()


def test_an_offer_of_another_machine_is_left_alone(
    open_bus: OpenBus, edge: Edge, wait_for: WaitFor
) -> None:
    with Token(open_bus(), "test/local/of-another-machine.sock"):
        wait_for(lambda: edge.end._offers, "the offer")
        wait_for(
            lambda: all(thread.name != "local robot" for thread in threading.enumerate()),
            "nobody to follow it",
        )
