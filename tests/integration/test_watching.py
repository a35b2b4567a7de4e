"""A run that is watched, with everything that can be watched, is the run that nobody watched."""

import threading
from typing import Any

import numpy as np
import pytest

from bpn.cli import parse
from bpn.local_run import new_run, private_endpoint
from bpn.options import given_run_options
from bpn.summary import summarize
from bpn.supervisor import Supervisor, services_of_run
from bpn_dashboard.hub.topology import Link, Topology, TopologySnapshot
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import TokenWatch
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.bus.watch import Subscriber
from bpn_shared.counters import Counters
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.preview import PreviewHeader, check_pixels
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.spec.config import RunConfig


@pytest.fixture(scope="module")
def watched(
    small: list[str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The run's summary, and what was seen of it."""
    options = parse(["train", "reaching", "--seed", "5", *small])
    config = RunConfig.for_task(options.task, **given_run_options(options))
    folder = new_run(tmp_path_factory.mktemp("runs"), config)
    endpoint, counters, topology = private_endpoint(), Counters(), Topology()
    seen: dict[str, Any] = {"previews": [], "decisions": [], "snapshots": [], "counters": counters}
    services = services_of_run(folder.run, folder.config(), folder.path.parent, endpoint)
    supervisor = Supervisor(services, folder.logs)

    def hear(report: Telemetry) -> None:
        topology.hear(report)
        seen["snapshots"].append(topology.snapshot())

    supervisor.start()
    try:
        with Bus(endpoint) as bus:
            watches = [
                Subscriber(bus, keys.preview(folder.run, 0), lambda *m: seen["previews"].append(m)),
                Subscriber(
                    bus, keys.decision(folder.run, 0), lambda *m: seen["decisions"].append(m)
                ),
                TelemetryWatch(bus, hear, counters),
                TokenWatch(bus, keys.live("*", "*"), topology.token),
            ]
            supervisor.wait("learner", threading.Event())
            for watch in watches:
                watch.close()
    finally:
        supervisor.stop()
    assert not supervisor.failure
    return summarize(folder), seen


def test_watching_changes_no_bit(
    undisturbed: dict[str, Any], watched: tuple[dict[str, Any], dict[str, Any]]
) -> None:
    summary, seen = watched
    assert seen["previews"]  # it was watched
    assert seen["decisions"]
    assert summary["weights_sha256"] == undisturbed["weights_sha256"]
    assert summary["returns"] == undisturbed["returns"]


def test_what_is_seen_is_what_the_network_sees_and_decides(
    watched: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    summary, seen = watched
    for attachment, pixels in seen["previews"]:
        header = PreviewHeader.decode(attachment)
        check_pixels(header, pixels)
        assert (header.channels, header.frames_stacked) == (1, 1)
        assert np.frombuffer(pixels, np.uint8).max() == 255  # the hand is in it
    decisions = [Decision.decode(payload) for _, payload in seen["decisions"]]
    assert len(decisions) < summary["transitions"]  # a sample
    for decision in decisions:
        assert decision.weights_version == decision.iteration
        assert decision.scale > 0
        assert 0 <= decision.action < len(decision.outputs) == 14
        assert 0 < decision.inference_ns < decision.edge_ns
    order = [(d.iteration, d.episode, d.step) for d in decisions]
    assert order == sorted(order)


def _is_certain(link: Link) -> bool:
    return link.latency is not None and link.latency.uncertainty_us == 0


def test_the_topology_shows_who_does_what_and_how_fast(
    watched: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    _, seen = watched
    assert seen["counters"].snapshot() == {}  # no report was refused
    snapshots: list[TopologySnapshot] = seen["snapshots"]
    kinds = {node.kind for snapshot in snapshots for node in snapshot.nodes if node.run}
    assert kinds == {"learner", "edge", "robot_sim"}
    # A link has a latency while its messages are recent, and a certain one once both ends have told
    # which clock they have: what is known best counts.
    links = {li.topic: li for s in snapshots for li in s.links}
    links |= {li.topic: li for s in snapshots for li in s.links if _is_certain(li)}
    assert {"frame", "action", "weights", "episode", "next", "reset"} <= links.keys()
    frame, action, weights = (links[topic] for topic in ("frame", "action", "weights"))
    assert (frame.source, frame.target) == (action.target, action.source)
    assert any(
        link.messages_per_s > 10 for s in snapshots for link in s.links if link.topic == "frame"
    )
    # Reports come once a second: of weights that follow each other faster, one may know no way to the edge.
    for link in (frame, action, *([weights] if weights.latency else [])):
        assert link.latency is not None, link.topic
        assert 0 < link.latency.p50_us <= link.latency.p99_us
        assert link.latency.uncertainty_us == 0
    edge = next(n for n in reversed(snapshots[-1].nodes) if n.kind == "edge")
    total = edge.latencies["camera_to_action_us"].p50_us
    assert edge.latencies["inference_us"].p50_us < edge.latencies["edge_us"].p50_us < total
    assert edge.weights["running"].version <= edge.weights["loaded"].version
