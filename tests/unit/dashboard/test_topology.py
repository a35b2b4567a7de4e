from typing import Any

import pytest

from bpn_dashboard.hub.topology import Link, Node, Topology
from bpn_shared.bus import keys
from bpn_shared.messages.telemetry import KeyTraffic, Percentiles, Telemetry, WeightsMark

RUN = "0198c0de-0000-7000-8000-000000000001"
FRAME, ACTION = f"bpn/{RUN}/robot/0/frame", f"bpn/{RUN}/robot/0/action"
WEIGHTS, EPISODE = f"bpn/{RUN}/weights", f"bpn/{RUN}/learner/episode"
S = 1_000_000_000


def report(kind: str, worker: str = "", **changes: Any) -> Telemetry:
    values: dict[str, Any] = {
        "run": RUN, "slot": 0, "host": "cell", "clock": "boot-1", "pid": 7, "time_ns": 100 * S,
        "uptime_s": 50.0, "waiting_for": None, "waiting_s": 0.0, "cpu_percent": 3.0,
        "rss_bytes": 10**8, "counters": {}, "weights": {}, "latencies": {}, "traffic": [],
    }  # fmt: skip
    return Telemetry(
        kind=kind, worker=worker or f"{kind.replace('_', '-')}-1", **{**values, **changes}
    )


def sent(key: str, messages: int, size: int = 10, dropped: int = 0) -> KeyTraffic:
    return KeyTraffic(
        key=key, direction="sent", messages=messages, bytes=messages * size, dropped=dropped
    )


def received(key: str, messages: int, dropped: int = 0) -> KeyTraffic:
    return KeyTraffic(
        key=key, direction="received", messages=messages, bytes=messages * 10, dropped=dropped
    )


def us(p50: float, p99: float) -> Percentiles:
    return Percentiles(count=9, p50_us=p50, p95_us=p99, p99_us=p99, max_us=p99)


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def topology(clock: Clock) -> Topology:
    return Topology(clock)


def node(topology: Topology, worker: str) -> Node | None:
    return next((n for n in topology.snapshot().nodes if n.id == worker), None)


def state(topology: Topology, worker: str) -> str | None:
    found = node(topology, worker)
    return None if found is None else found.state


def link(topology: Topology, topic: str) -> Link:
    (found,) = (each for each in topology.snapshot().links if each.topic == topic)
    return found


def test_a_service_that_hangs_is_stale_until_its_token_goes(
    topology: Topology, clock: Clock
) -> None:
    topology.token(keys.live("edge", "edge-1"), True)
    assert state(topology, "edge-1") == "live"
    topology.hear(report("edge", waiting_for="a frame", waiting_s=2.0))
    clock.now_s += 2.9
    found = node(topology, "edge-1")
    assert found is not None
    assert (found.state, found.age_s) == ("live", 2.9)
    assert (found.waiting_for, found.waiting_s) == ("a frame", 4.9)
    clock.now_s += 0.2
    assert state(topology, "edge-1") == "stale"
    clock.now_s += 600
    assert state(topology, "edge-1") == "stale"  # its process is there and does nothing
    topology.token(keys.live("edge", "edge-1"), False)
    assert state(topology, "edge-1") == "dead"
    clock.now_s += 59
    assert state(topology, "edge-1") == "dead"
    clock.now_s += 2
    assert state(topology, "edge-1") is None  # forgotten


def test_without_a_token_reports_alone_tell(topology: Topology, clock: Clock) -> None:
    topology.hear(report("edge"))
    assert state(topology, "edge-1") == "live"
    clock.now_s += 5
    assert state(topology, "edge-1") == "stale"
    clock.now_s += 6
    assert state(topology, "edge-1") == "dead"
    topology.hear(report("edge"))
    assert state(topology, "edge-1") == "live"


def test_a_token_without_a_report_is_stale_after_a_while(topology: Topology, clock: Clock) -> None:
    topology.token(keys.live("learner", "learner-1"), True)
    clock.now_s += 4
    found = node(topology, "learner-1")
    assert found is not None
    assert (found.state, found.age_s, found.run) == ("stale", None, None)


def test_a_router_that_comes_back_brings_the_living_back(topology: Topology) -> None:
    topology.hear(report("edge"))
    topology.token(keys.live("edge", "edge-1"), False)
    assert state(topology, "edge-1") == "dead"
    topology.token(keys.live("edge", "edge-1"), True)
    assert state(topology, "edge-1") == "live"


def test_links_join_who_sends_and_who_receives_with_the_rates_of_the_sender(
    topology: Topology,
) -> None:
    topology.hear(report("robot_sim", traffic=[sent(FRAME, 100), received(ACTION, 90)]))
    topology.hear(report("edge", traffic=[received(FRAME, 95), sent(ACTION, 95)]))
    later = 102 * S
    topology.hear(
        report("robot_sim", time_ns=later, traffic=[sent(FRAME, 150), received(ACTION, 140, 4)])
    )
    topology.hear(report("edge", time_ns=later, traffic=[received(FRAME, 145), sent(ACTION, 145)]))
    frame, action = link(topology, "frame"), link(topology, "action")
    assert (frame.source, frame.target, frame.run) == ("robot-sim-1", "edge-1", RUN)
    assert (frame.messages, frame.messages_per_s, frame.bytes_per_s) == (150, 25.0, 250.0)
    assert (action.source, action.target, action.form) == ("edge-1", "robot-sim-1", "stream")
    assert (action.dropped, action.dropped_per_s) == (4, 2.0)  # the robot's slot dropped them
    topology.token(keys.live("edge", "edge-1"), False)
    assert topology.snapshot().links == []


def test_requests_count_what_was_not_answered_where_it_was_asked(topology: Topology) -> None:
    topology.hear(report("edge", traffic=[sent(EPISODE, 10, dropped=3)]))
    topology.hear(report("edge", "edge-2", slot=1, traffic=[sent(EPISODE, 20)]))
    topology.hear(report("learner", slot=None, traffic=[received(EPISODE, 27)]))
    links = sorted(topology.snapshot().links, key=lambda each: each.source)
    assert [(each.source, each.target, each.form) for each in links] == [
        ("edge-1", "learner-1", "request"),
        ("edge-2", "learner-1", "request"),
    ]
    assert [(each.messages, each.dropped) for each in links] == [(10, 3), (20, 0)]


def test_hops_of_one_clock_are_measured_and_of_two_are_halved_with_the_doubt(
    topology: Topology,
) -> None:
    latencies = {
        "camera_to_edge_us": us(100, 300), "action_to_robot_us": us(80, 200), "bus_us": us(200, 500),
    }  # fmt: skip
    topology.hear(report("robot_sim", traffic=[sent(FRAME, 1), received(ACTION, 1)]))
    edge_traffic = [received(FRAME, 1), sent(ACTION, 1)]
    topology.hear(report("edge", traffic=edge_traffic, latencies=latencies))
    frame, action = link(topology, "frame").latency, link(topology, "action").latency
    assert frame is not None
    assert action is not None
    assert (frame.p50_us, frame.p95_us, frame.p99_us, frame.uncertainty_us) == (100, 300, 300, 0)
    assert (action.p50_us, action.p99_us, action.uncertainty_us) == (80, 200, 0)
    topology.hear(report("edge", clock="boot-2", traffic=edge_traffic, latencies=latencies))
    for topic in ("frame", "action"):
        halved = link(topology, topic).latency
        assert halved is not None
        assert (halved.p50_us, halved.p99_us, halved.uncertainty_us) == (100, 250, 100)


def test_the_way_of_weights_is_measured_once_per_version_and_edge(topology: Topology) -> None:
    def learner(version: int, time_ns: int) -> Telemetry:
        mark = WeightsMark(attempt=1, version=version, time_ns=time_ns)
        return report(
            "learner", slot=None, weights={"published": mark}, traffic=[sent(WEIGHTS, version)]
        )

    def edge(version: int, time_ns: int, uptime_s: float = 50.0) -> Telemetry:
        mark = WeightsMark(attempt=1, version=version, time_ns=time_ns)
        traffic = [received(WEIGHTS, version)]
        return report("edge", weights={"loaded": mark}, traffic=traffic, uptime_s=uptime_s)

    topology.hear(edge(1, 90 * S + 2_000_000))
    topology.hear(learner(1, 90 * S))
    topology.hear(learner(1, 90 * S))
    first = link(topology, "weights").latency
    assert first is not None
    assert (first.count, first.p50_us) == (1, 2000.0)
    topology.hear(learner(2, 92 * S))
    topology.hear(edge(2, 92 * S + 4_000_000))
    both = link(topology, "weights").latency
    assert both is not None
    assert (both.count, both.p50_us, both.p95_us, both.p99_us) == (2, 3000.0, 4000.0, 4000.0)
    # an edge that began later did not get them on their way
    topology.token(keys.live("edge", "edge-1"), False)
    young = edge(2, 99 * S, uptime_s=2.0).model_copy(update={"worker": "edge-2"})
    topology.hear(young)
    assert link(topology, "weights").latency is None


def test_a_snapshot_is_json_with_units_in_its_names(topology: Topology) -> None:
    topology.hear(
        report(
            "edge", latencies={"edge_us": us(1, 2)}, counters={"frames_refused": 1},
            weights={"running": WeightsMark(attempt=1, version=4, time_ns=90 * S)},
        )
    )  # fmt: skip
    (said,) = topology.snapshot().model_dump(mode="json")["nodes"]
    assert said["weights"] == {"running": {"attempt": 1, "version": 4, "time_unix_s": 90.0}}
    assert said["latencies"]["edge_us"]["p99_us"] == 2
    assert (said["cpu_percent"], said["rss_bytes"], said["host"]) == (3.0, 10**8, "cell")


def test_what_flowed_for_an_earlier_lease_is_no_flow_of_the_present_run(
    topology: Topology,
) -> None:
    earlier = FRAME.replace(FRAME.split("/")[1], "0190a1b2-0000-7000-8000-000000000001")
    topology.hear(report("robot_sim", traffic=[sent(earlier, 9), sent(FRAME, 1)]))
    topology.hear(report("edge", traffic=[received(earlier, 9), received(FRAME, 1)]))
    assert link(topology, "frame").key == FRAME
