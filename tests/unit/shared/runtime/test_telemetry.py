import os
import threading
from datetime import UTC, datetime, timedelta
from uuid import uuid4

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bus.traffic import MAX_KEYS, Traffic
from bpn_shared.bus.x509 import Life
from bpn_shared.counters import Counters
from bpn_shared.runtime.service import new_worker_id
from bpn_shared.runtime.telemetry import (
    LATENCY_WINDOW_S,
    Latencies,
    ProcessUsage,
    Reporter,
    WeightsTimeline,
)
from bpn_shared.waiting import WaitStatus


@given(st.lists(st.lists(st.floats(-1e6, 1e6), max_size=50), min_size=1, max_size=20))
def test_percentiles_are_numpys_over_all_that_was_added(batches: list[list[float]]) -> None:
    latencies = Latencies(now_s=lambda: 0.0)
    for batch in batches:
        latencies.add("edge_us", batch)
    every = [value for batch in batches for value in batch]
    if not every:
        assert latencies.snapshot() == {}
        return
    told = latencies.snapshot()["edge_us"]
    assert told.count == len(every)
    expected = np.percentile(every, [50, 95, 99, 100])
    np.testing.assert_allclose(
        [told.p50_us, told.p95_us, told.p99_us, told.max_us], expected, atol=0.01
    )


def test_old_durations_are_forgotten_and_many_are_bounded() -> None:
    now_s = 0.0
    latencies = Latencies(now_s=lambda: now_s)
    latencies.add("edge_us", 1000.0)
    now_s = LATENCY_WINDOW_S
    latencies.add("edge_us", 10.0)
    assert latencies.snapshot()["edge_us"].count == 2
    now_s += 0.1
    assert latencies.snapshot()["edge_us"].max_us == 10.0
    for _ in range(10_000):
        latencies.add("edge_us", 1.0)
    assert latencies.snapshot()["edge_us"].count < 1000
    now_s += LATENCY_WINDOW_S + 0.1
    assert latencies.snapshot() == {}


def test_memory_and_processor_are_what_the_system_says() -> None:
    usage, process = ProcessUsage(), psutil.Process()
    stop = threading.Event()
    process.cpu_percent()
    timer = threading.Timer(0.5, stop.set)
    timer.start()
    while not stop.is_set():
        sum(range(1000))
    ours, theirs = usage.cpu_percent(), process.cpu_percent()
    assert abs(ours - theirs) < 20
    assert abs(usage.rss_bytes() - process.memory_info().rss) < 20e6
    assert usage.cpu_percent() == ours  # asked again at once


@pytest.mark.parametrize("kind", ["learner", "edge", "robot_sim", "dashboard"])
def test_every_kind_of_service_can_report(kind: str) -> None:
    reporter = Reporter(
        kind, new_worker_id(kind), lambda: (uuid4(), 0), Traffic(), waiting=WaitStatus(),
        counters=Counters(), latencies=Latencies(), weights=WeightsTimeline(),
    )  # fmt: skip
    assert reporter.report().kind == kind


def test_a_report_holds_what_its_parts_know() -> None:
    traffic, waiting, counters = Traffic(), WaitStatus(), Counters()
    traffic.sent("bpn/a/frame").add(7)
    traffic.received("bpn/a/action").add(3)
    traffic.received("bpn/a/action").dropped += 1
    waiting.set("x" * 600)
    reporter = Reporter(
        "edge", "edge-1", lambda: (None, None), traffic,
        waiting=waiting, counters=counters, latencies=Latencies(), weights=WeightsTimeline(),
    )  # fmt: skip
    report = reporter.report()
    assert type(report).decode(report.encode()) == report
    assert report.pid == os.getpid()
    assert report.waiting_for == "x" * 500  # cut, not refused
    told = [(t.key, t.direction, t.messages, t.bytes, t.dropped) for t in report.traffic]
    assert told == [("bpn/a/frame", "sent", 1, 7, 0), ("bpn/a/action", "received", 1, 3, 1)]


def test_a_service_that_uses_many_keys_still_fits_into_a_message() -> None:
    traffic = Traffic()
    for number in range(3 * MAX_KEYS):
        traffic.sent(f"bpn/{'0' * 36}/robot/{number}/frame").add(1)
        traffic.received(f"bpn/{'0' * 36}/robot/{number}/action").add(1)
    reporter = Reporter(
        "edge", "edge-1", lambda: (None, None), traffic, waiting=WaitStatus(),
        counters=Counters(), latencies=Latencies(), weights=WeightsTimeline(),
    )  # fmt: skip
    report = reporter.report()
    assert type(report).decode(report.encode()) == report
    assert f"/{3 * MAX_KEYS - 1}/frame" in report.traffic[MAX_KEYS - 1].key  # the newest are kept


def test_a_report_tells_how_long_the_certificates_are_good() -> None:
    start = datetime(2026, 1, 1, tzinfo=UTC)
    lives = [None, Life(start, start + timedelta(days=365))]
    reporter = Reporter(
        "edge", "edge-1", lambda: (None, None), Traffic(), waiting=WaitStatus(), counters=Counters(),
        latencies=Latencies(), weights=WeightsTimeline(), certificate=lambda: lives[-1],
    )  # fmt: skip
    told = reporter.report().certificate
    assert told is not None
    assert datetime.fromtimestamp(told.end_unix_s, UTC) == start + timedelta(days=365)
    lives.append(None)
    assert reporter.report().certificate is None
