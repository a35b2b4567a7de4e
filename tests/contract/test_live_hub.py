"""What the live view tells: frames, decisions, metrics, logs, topology."""

import contextlib
import itertools
import time
from collections.abc import Callable
from typing import Any

import pytest
from live_view import CAMERA, RUN, OpenBus, Robot, Server, Tab, WaitFor, first_frame

from bpn_dashboard.hub import topics
from bpn_dashboard.hub.protocol import CREDIT
from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.metrics import MetricsPublisher
from bpn_shared.bus.sampled import SampledPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryPublisher
from bpn_shared.counters import Counters
from bpn_shared.messages.decision import Decision
from bpn_shared.runtime.telemetry import Latencies, Reporter, WeightsTimeline
from bpn_shared.waiting import WaitStatus


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
    robot = SampledPublisher[int](
        open_bus(), keys.preview(RUN, 0), 30.0, lambda _step: (b"", None), Counters()
    )
    first, second = tab(), tab()
    assert not robot.has_subscribers
    one = first.subscribe(CAMERA)
    two = first.subscribe(CAMERA)
    second.subscribe(CAMERA)
    wait_for(lambda: robot.has_subscribers, "the robot to be watched")
    wait_for(lambda: server.view._open[topics.Topic.parse(CAMERA)].subscribers == 3, "all three")
    first.say(op="unsub", id=one)
    first.say(op="unsub", id=two)
    first.say(op="unsub", id=two)  # once more is no harm
    assert first.silent()
    assert robot.has_subscribers
    second.close()
    wait_for(lambda: not robot.has_subscribers, "the robot to be left alone")
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


def test_alerts_are_told_to_every_page_that_is_open(
    server: Server, tab: Callable[..., Tab]
) -> None:
    page = tab()
    page.subscribe("alerts", since=0)
    server.view.publish("alerts", {"id": 1, "text": "it failed"})
    assert page.hear()["data"] == {"id": 1, "text": "it failed"}


def test_only_topics_without_a_source_are_published_by_hand(server: Server) -> None:
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
    page, bus, waiting = tab(), open_bus(), WaitStatus()
    waiting.set("a frame from robot 0")
    reporter = Reporter(
        "edge", "edge-1", lambda: (RUN, 0), bus.traffic, waiting=waiting,
        counters=Counters(), latencies=Latencies(), weights=WeightsTimeline(),
    )  # fmt: skip
    publisher = TelemetryPublisher(bus, "edge", "edge-1", reporter.report, Counters())
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
