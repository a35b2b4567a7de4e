"""The live view as browsers get it: a real server, real WebSockets, real Zenoh."""

import contextlib
import itertools
import json
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import psutil
import pytest
import uvicorn
from fastapi import FastAPI
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from bpn_dashboard.access.guard import Guard
from bpn_dashboard.hub import topics, websocket
from bpn_dashboard.hub.hub import Hub
from bpn_dashboard.hub.protocol import CREDIT, LiveFrame
from bpn_dashboard.hub.topology import Topology
from bpn_dashboard.hub.websocket import PATH, UVICORN_OPTIONS, live_route
from bpn_shared import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.metrics import MetricsPublisher
from bpn_shared.bus.sampled import SampledPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryPublisher
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.preview import PreviewHeader
from bpn_shared.service import Counters, Waiting
from bpn_shared.telemetry import Latencies, Reporter, WeightsMarks

OpenBus = Callable[[], Bus]
WaitFor = Callable[..., None]
RUN = uuid4()
CAMERA = f"camera/{RUN}/0"


@dataclass
class Server:
    """A dashboard that has nothing but the live view."""

    runs_dir: Path
    port: int = 0
    hub: Hub | None = None
    allowed: bool = True
    counters: Counters = field(default_factory=Counters)

    @property
    def view(self) -> Hub:
        assert self.hub is not None
        return self.hub


@pytest.fixture
def server(open_bus: OpenBus, tmp_path: Path, wait_for: WaitFor) -> Iterator[Server]:
    bus, made = open_bus(), Server(tmp_path)

    @contextlib.asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        made.hub = Hub(bus, tmp_path, made.counters, "dashboard-1", Topology())
        yield
        made.hub.close()

    app = FastAPI(lifespan=lifespan)
    app.include_router(
        live_route(lambda: made.view, lambda _connection: made.allowed, session_period_s=0.05)
    )
    running = uvicorn.Server(
        uvicorn.Config(Guard(app), port=0, log_level="error", **UVICORN_OPTIONS)
    )
    thread = threading.Thread(target=running.run)
    thread.start()
    wait_for(lambda: running.started, "the server to start")
    made.port = running.servers[0].sockets[0].getsockname()[1]
    yield made
    running.should_exit = True
    thread.join(20)
    assert not thread.is_alive()


class Tab:
    """A browser tab, as far as the protocol goes."""

    def __init__(self, server: Server, hello: bool = True, **options: Any) -> None:
        self._closing = contextlib.ExitStack()
        host = f"127.0.0.1:{server.port}"
        options = {"uri": f"ws://{host}{PATH}", "origin": f"http://{host}", **options}
        self.socket: ClientConnection = self._closing.enter_context(
            connect(compression=None, **options)
        )
        self._ids = itertools.count(1)
        if hello:
            self.say(op="hello", proto=1)
            self.welcome = self.hear()

    def close(self) -> None:
        self._closing.close()

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def subscribe(self, topic: str, **more: Any) -> int:
        subscription = next(self._ids)
        self.say(op="sub", id=subscription, topic=topic, **more)
        return subscription

    def hear(self, timeout_s: float = 20) -> Any:
        """The next message: a dict, or header and pixels."""
        message = self.socket.recv(timeout=timeout_s)
        return json.loads(message) if isinstance(message, str) else LiveFrame.decode(message)

    def silent(self) -> bool:
        """Nothing more has been sent: the answer to a ping is the next message."""
        self.say(op="ping", t=1.0)
        return bool(self.hear().get("op") == "pong")

    def closed_with(self) -> int | None:
        """The code that the server closes with, whatever it said before."""
        try:
            while True:
                self.hear()
        except ConnectionClosed as closed:
            return closed.rcvd.code if closed.rcvd else None


@pytest.fixture
def tab(server: Server) -> Iterator[Callable[..., Tab]]:
    opened: list[Tab] = []

    def open_tab(**options: Any) -> Tab:
        opened.append(Tab(server, **options))
        return opened[-1]

    yield open_tab
    for each in opened:
        each.close()


class Robot:
    """Sends previews as fast as it is told, with the step as the value of every pixel."""

    def __init__(self, bus: Bus, run: UUID = RUN, channels: int = 1) -> None:
        self._publisher = LatestPublisher(bus, keys.preview(run, 0), "frame")
        self._channels = channels
        self.step = 0

    def show(self) -> int:
        self.step += 1
        header = PreviewHeader(self._channels, 1, 0, 0, self.step, time.time_ns())
        pixels = bytes([self.step % 256]) * (84 * 84 * self._channels)
        self._publisher.put(pixels, header.encode())
        return self.step


def first_frame(tab: Tab, robot: Robot) -> tuple[LiveFrame, bytes]:
    """Shows frames until the subscription has reached the robot."""
    for _ in range(200):
        robot.show()
        with contextlib.suppress(TimeoutError):
            frame: tuple[LiveFrame, bytes] = tab.hear(0.1)
            return frame
    raise AssertionError("no frame came")


def test_the_server_says_who_it_is_and_what_time(tab: Callable[..., Tab]) -> None:
    page = tab()
    assert (page.welcome["op"], page.welcome["server"]) == ("welcome", "dashboard-1")
    assert abs(page.welcome["now_unix_s"] - time.time()) < 5
    page.say(op="ping", t=12.5)
    pong = page.hear()
    assert (pong["op"], pong["t"]) == ("pong", 12.5)


def test_a_camera_sends_the_newest_and_never_more_than_two_ahead(
    server: Server, tab: Callable[..., Tab], open_bus: OpenBus, wait_for: WaitFor
) -> None:
    page, robot = tab(), Robot(open_bus())
    camera = page.subscribe(CAMERA, rate_hz=1000)
    frame, pixels = first_frame(page, robot)
    assert (frame.subscription, frame.channels, frame.height_px, frame.width_px) == (
        camera,
        1,
        84,
        84,
    )
    assert frame.frames_stacked == 1
    assert frame.t_capture_unix_s <= frame.t_hub_unix_s + 0.001
    assert len(set(pixels)) == 1
    seen, heard = [frame.seq], 1

    def newest() -> int:
        return server.view._open[topics.Topic.parse(CAMERA)].channel.seq

    for _ in range(20):
        before = newest()
        robot.show()
        wait_for(lambda before=before: newest() > before, "the hub to get the frame")
    while heard < CREDIT:
        seen.append(page.hear()[0].seq)
        heard += 1
    assert page.silent()  # eighteen frames later: two were on their way
    page.say(op="ack", id=camera, seq=seen[-1])
    frame, pixels = page.hear()
    assert frame.seq == newest()
    assert set(pixels) == {robot.step % 256}
    assert page.silent()


def test_the_rate_is_capped(tab: Callable[..., Tab], open_bus: OpenBus) -> None:
    page, robot = tab(), Robot(open_bus())
    camera = page.subscribe(CAMERA, rate_hz=10)
    frame, _ = first_frame(page, robot)
    page.say(op="ack", id=camera, seq=frame.seq)
    start_s, frames = time.monotonic(), 0
    while time.monotonic() < start_s + 1.0:
        robot.show()
        with contextlib.suppress(TimeoutError):
            frame, _ = page.hear(0.01)
            page.say(op="ack", id=camera, seq=frame.seq)
            frames += 1
    assert 2 <= frames <= (time.monotonic() - start_s) * 10 + 2


def test_a_slot_is_watched_once_for_all_and_only_while_somebody_looks(
    server: Server, tab: Callable[..., Tab], open_bus: OpenBus, wait_for: WaitFor
) -> None:
    robot = SampledPublisher[int](open_bus(), keys.preview(RUN, 0), 30.0, lambda _step: (b"", None))
    first, second = tab(), tab()
    assert not robot.watched
    one = first.subscribe(CAMERA)
    two = first.subscribe(CAMERA)
    second.subscribe(CAMERA)
    wait_for(lambda: robot.watched, "the robot to be watched")
    wait_for(lambda: server.view._open[topics.Topic.parse(CAMERA)].subscribers == 3, "all three")
    first.say(op="unsub", id=one)
    first.say(op="unsub", id=two)
    first.say(op="unsub", id=two)  # once more is no harm
    assert first.silent()
    assert robot.watched
    second.close()
    wait_for(lambda: not robot.watched, "the robot to be left alone")
    assert CAMERA not in server.view.open_topics
    wait_for(lambda: server.view.clients == 1, "the closed tab to be forgotten")
    robot.close()


def test_decisions_come_with_their_preferences(tab: Callable[..., Tab], open_bus: OpenBus) -> None:
    page = tab()
    page.subscribe(f"actions/{RUN}/0")
    decision = Decision(
        iteration=1, episode=2, step=3, action=1, outputs=[-2, 4], scale=0.5, weights_version=1,
        inference_ns=5000, edge_ns=90_000, time_ns=1_500_000_000,
    )  # fmt: skip
    publisher = LatestPublisher(open_bus(), keys.decision(RUN, 0), "action")
    heard = None
    while heard is None:
        publisher.put(decision.encode())
        with contextlib.suppress(TimeoutError):
            heard = page.hear(0.1)
    assert heard["data"] == {
        "iteration": 1, "episode": 2, "step": 3, "action": 1, "outputs": [-2, 4],
        "preferences": [-1.0, 2.0], "scale": 0.5, "weights_version": 1, "inference_us": 5.0,
        "edge_us": 90.0, "time_unix_s": 1.5,
    }  # fmt: skip


def test_garbage_from_the_bus_is_counted_and_the_view_goes_on(
    server: Server, tab: Callable[..., Tab], open_bus: OpenBus, wait_for: WaitFor
) -> None:
    page, bus = tab(), open_bus()
    page.subscribe(CAMERA)
    garbage = LatestPublisher(bus, keys.preview(RUN, 0), "frame")

    def refused() -> bool:
        garbage.put(b"no pixels", b"no header")
        return server.counters.snapshot().get("live_refused", 0) > 0

    wait_for(refused, "garbage to be counted")
    assert first_frame(page, Robot(bus))[0].channels == 1


class Learner:
    """Publishes numbered metrics."""

    def __init__(self, bus: Bus) -> None:
        self._publisher = MetricsPublisher(bus, RUN, "learner", "learner-1")
        self._steps = itertools.count()

    def tell(self) -> int:
        step = next(self._steps)
        self._publisher.put(step, {"loss": step / 2})
        return step


def test_metrics_go_on_where_a_lost_connection_ended(
    tab: Callable[..., Tab], open_bus: OpenBus, wait_for: WaitFor, server: Server
) -> None:
    page, learner, topic = tab(), Learner(open_bus()), f"metrics/{RUN}"
    page.subscribe(topic)
    heard = None
    while heard is None:
        learner.tell()
        with contextlib.suppress(TimeoutError):
            heard = page.hear(0.1)
    (point,) = heard["data"]["points"]
    assert (point["name"], point["value"]) == ("loss", point["step"] / 2)
    page.close()
    wait_for(lambda: server.view.clients == 0, "the tab to be gone")
    assert topic in server.view.open_topics  # kept for a while
    later = [learner.tell() for _ in range(5)]
    back = tab()
    back.subscribe(topic, since=heard["seq"])
    steps: list[int] = []
    while not steps or steps[-1] < later[-1]:
        message = back.hear()
        assert message["op"] == "data"  # no gap
        steps.append(message["data"]["points"][0]["step"])
    assert steps == list(range(point["step"] + 1, later[-1] + 1))


def test_what_is_no_longer_kept_is_an_explicit_gap(tab: Callable[..., Tab], server: Server) -> None:
    changes = topics.DELIVERY["runs"].kept + 50
    page = tab()
    for number in range(changes):
        server.view.publish("runs", {"id": str(number)})
    page.subscribe("runs", since=10)
    seen: list[int] = []
    gap = page.hear()
    assert (gap["op"], gap["missed"] >= 0) == ("gap", True)
    while not seen or seen[-1] < changes:
        message = page.hear()
        assert message["op"] == "data"
        assert message["data"] == {"id": str(message["seq"] - 1)}
        seen.append(message["seq"])
    assert seen == list(range(10 + gap["missed"] + 1, changes + 1))
    page.subscribe("runs", since=10**6)
    assert page.hear() == {"op": "gap", "id": 2, "missed": None}


def test_only_the_runs_topic_is_published_by_hand(server: Server) -> None:
    with pytest.raises(ValueError, match="has a source of its own"):
        server.view.publish("topology", {})


def test_logs_are_told_from_their_tail_and_followed(
    server: Server, tab: Callable[..., Tab]
) -> None:
    logs = server.runs_dir / str(RUN) / "logs"
    logs.mkdir(parents=True)
    path = logs / "edge-0.log"
    path.write_text("2026-11-22T08:22:35.000Z edge-0 INFO before\n")
    page = tab()
    page.subscribe(f"logs/{RUN}", since=0)
    first = page.hear()["data"]
    assert first == {
        "id": "edge-0:0", "time_unix_s": 1795335755.0, "level": "INFO", "service": "edge-0",
        "message": "before",
    }  # fmt: skip
    with path.open("a") as file:
        file.write("2026-11-22T08:22:36.000Z edge-0 ERROR after\n")
    assert (page.hear()["data"]["message"]) == "after"


def test_topology_follows_a_service_from_birth_to_death(
    tab: Callable[..., Tab], open_bus: OpenBus
) -> None:
    page, bus, waiting = tab(), open_bus(), Waiting()
    waiting.set("a frame from robot 0")
    reporter = Reporter(
        "edge", "edge-1", lambda: (RUN, 0), bus.traffic, waiting=waiting,
        counters=Counters(), latencies=Latencies(), weights=WeightsMarks(),
    )  # fmt: skip
    publisher = TelemetryPublisher(bus, "edge", "edge-1", reporter.report)
    token = AliveToken(bus, "edge", "edge-1")
    page.subscribe("topology")

    def wait_until(accept: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        for _ in range(30):
            for node in page.hear()["data"]["nodes"]:
                if node["id"] == "edge-1" and accept(node):
                    found: dict[str, Any] = node
                    return found
        raise AssertionError("the topology never showed it")

    alive = wait_until(lambda node: node["state"] == "live" and node["run"] is not None)
    assert (alive["kind"], alive["run"], alive["slot"]) == ("edge", str(RUN), 0)
    assert alive["waiting_for"] == "a frame from robot 0"
    assert alive["rss_bytes"] > 10**6
    publisher.close()
    wait_until(lambda node: node["state"] == "stale")  # its token is there, but it says nothing
    del token
    bus.close()
    wait_until(lambda node: node["state"] == "dead")


def test_who_reads_nothing_costs_little_and_delays_nobody(
    server: Server, tab: Callable[..., Tab], open_bus: OpenBus, wait_for: WaitFor
) -> None:
    """12 channels of 84 x 84, 85 KB a frame, flooded: unbounded, memory would grow by far more."""
    stuck = socket.create_connection(("127.0.0.1", server.port))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf, lively = tab(sock=stuck, max_queue=1, ping_interval=None), tab()
    robot = Robot(open_bus(), channels=12)
    deaf.subscribe(CAMERA)
    deaf.subscribe("runs")
    camera = lively.subscribe(CAMERA)
    runs = lively.subscribe("runs")
    frame, _ = first_frame(lively, robot)
    before_bytes = psutil.Process().memory_info().rss
    last, frames, changes = 5000, 0, 0
    for number in range(1, last + 1):
        robot.show()
        if number % 5 == 0:
            server.view.publish("runs", {"id": number, "notes": "x" * 10_000})
        if number % 100 == 0:
            lively.say(op="ack", id=camera, seq=frame.seq)
            heard = lively.hear()
            while not isinstance(heard, tuple) or changes < number // 5 - 500:
                if isinstance(heard, tuple):
                    frame, frames = heard[0], frames + 1
                else:
                    assert (heard["op"], heard["id"]) == ("data", runs)  # none is missing
                    changes += 1
                heard = lively.hear()
            frame, frames = heard[0], frames + 1
    while changes < last // 5:
        heard = lively.hear()
        changes += not isinstance(heard, tuple)
    assert frames >= 45
    grown_bytes = psutil.Process().memory_info().rss - before_bytes
    assert grown_bytes < 40e6  # the flood was 425 MB
    stuck.close()
    wait_for(lambda: server.view.clients == 1, "the deaf client to be forgotten")


@pytest.mark.parametrize(
    ("message", "title"),
    [
        ({"op": "sub", "id": 5, "topic": "weather"}, "topic 'weather' is unknown"),
        ({"op": "sub", "id": 5, "topic": f"logs/{UUID(int=0)}"}, "no run 00000000"),
        ({"op": "sub", "id": 5, "topic": "runs", "rate_hz": -1}, "rate_hz"),
        ({"op": "hello", "proto": 1}, "hello comes once"),
        ({"op": "shout"}, "'shout'"),
    ],
)
def test_what_is_refused_says_why_and_the_connection_goes_on(
    tab: Callable[..., Tab], message: dict[str, Any], title: str
) -> None:
    page = tab()
    page.say(**message)
    error = page.hear()
    assert error["op"] == "error"
    assert title in error["title"]
    assert page.silent()


def test_an_id_is_one_subscription_and_there_is_a_limit(tab: Callable[..., Tab]) -> None:
    page = tab()
    page.say(op="sub", id=1, topic="runs")
    page.say(op="sub", id=1, topic="topology")
    assert "id 1 is in use" in page.hear()["title"]
    for number in range(2, 66):
        page.say(op="sub", id=number, topic="runs")
    assert page.hear() == {"op": "error", "id": 65, "title": "more than 64 subscriptions"}


def test_without_a_session_nothing_is_told(
    server: Server, tab: Callable[..., Tab], wait_for: WaitFor
) -> None:
    page = tab()
    page.subscribe("topology")
    server.allowed = False
    assert page.closed_with() == websocket.CLOSE_NO_SESSION  # the session ended meanwhile
    stranger = tab(hello=False)
    assert stranger.closed_with() == websocket.CLOSE_NO_SESSION
    wait_for(lambda: server.view.clients == 0, "both to be forgotten")


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1", "http://evil.example"),
        ("127.0.0.1", "http://127.0.0.1:1"),
        ("127.0.0.1", "null"),
        ("127.0.0.1", None),
        ("evil.example", "http://evil.example:{port}"),
    ],
)
def test_other_sites_and_rebound_names_do_not_get_a_handshake(
    server: Server, tab: Callable[..., Tab], host: str, origin: str | None
) -> None:
    link = socket.create_connection(("127.0.0.1", server.port))
    given = None if origin is None else origin.format(port=server.port)
    with link, pytest.raises(InvalidStatus) as refused:
        tab(uri=f"ws://{host}:{server.port}{PATH}", origin=given, sock=link)
    assert refused.value.response.status_code == 403
    assert server.view.clients == 0


@pytest.mark.parametrize(
    "first",
    ['{"op":"sub","id":1,"topic":"runs"}', '{"op":"hello","proto":2}', "no json", b"binary"],
)
def test_whoever_does_not_speak_the_protocol_is_sent_away(
    tab: Callable[..., Tab], first: str | bytes
) -> None:
    page = tab(hello=False)
    page.socket.send(first)
    assert page.closed_with() == websocket.CLOSE_PROTOCOL


def test_errors_without_end_and_oversized_messages_end_the_connection(
    tab: Callable[..., Tab],
) -> None:
    page = tab()
    for _ in range(101):
        page.say(op="shout")
    assert page.closed_with() == websocket.CLOSE_PROTOCOL
    large = tab()
    large.socket.send("x" * 100_000)
    assert large.closed_with() == 1009


def test_there_is_room_for_a_hundred(
    server: Server, tab: Callable[..., Tab], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.hub.hub.MAX_CLIENTS", 2)
    tab(), tab()
    assert tab(hello=False).closed_with() == websocket.CLOSE_FULL
    assert server.counters.snapshot()["live_clients_refused"] == 1
