"""/metrics: a sample of all that an alarm may watch, before it happens; of runs and workers what is there now."""

import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from bpn_dashboard.api.context import Context
from bpn_dashboard.api.prometheus import Families
from bpn_dashboard.certificates import Certificate
from bpn_dashboard.exposition import runs, workers
from bpn_dashboard.hub.refusals import RefusalTotals
from bpn_dashboard.hub.topology import Topology
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.bus.x509 import Life
from bpn_shared.messages.telemetry import CertificateLife, Telemetry
from bpn_shared.runs.state import STATES
from bpn_shared.runtime.watchdog import CAUSE_KINDS
from bpn_shared.spec.config import RunConfig
from bpn_shared.version import PROTOCOL

PAGE = Path(__file__).parents[3] / "docs" / "observability.md"
DAY = timedelta(days=1)


def samples(client: TestClient) -> dict[str, float]:
    """By name and labels, as Prometheus reads them."""
    text = client.get("/metrics").text
    return {
        f"{s.name}{dict(sorted(s.labels.items())) or ''}": s.value
        for family in text_string_to_metric_families(text)
        for s in family.samples
    }


def report(worker: str, **more: Any) -> Telemetry:
    values: dict[str, Any] = {
        "kind": worker.rsplit("-", 1)[0].replace("-", "_"), "worker": worker, "run": None, "slot": None,
        "host": "cell", "clock": "c", "pid": 1, "time_ns": time.time_ns(), "uptime_s": 1.0,
        "waiting_for": None, "waiting_s": 0.0, "cpu_percent": 0.0, "rss_bytes": 2**20, "counters": {},
        "weights": {}, "latencies": {}, "traffic": [], "version": "1.2", "protocol": PROTOCOL,
    }  # fmt: skip
    return Telemetry(**(values | more))


@pytest.fixture
def topology(context: Context) -> Topology:
    topology = Topology()
    context.topology, context.refusals = topology.snapshot, topology.refusals
    return topology


def test_what_may_happen_has_a_sample_before_it_does(client: TestClient, store: RunStore) -> None:
    store.create(RunConfig(), actor="test")
    seen = samples(client)
    for state in STATES:
        assert seen[f"bpn_runs{{'state': '{state}'}}"] == (1.0 if state == "queued" else 0.0)
    for kind in CAUSE_KINDS:
        assert seen[f"bpn_runs_waiting{{'reason': '{kind}'}}"] == 0.0
    for kind in workers.KINDS:
        for state in ("idle", "working", "silent"):
            assert seen[f"bpn_workers{{'kind': '{kind}', 'state': '{state}'}}"] == 0.0
        assert seen[f"bpn_places_vacant{{'kind': '{kind}'}}"] == 0.0
        assert seen[f"bpn_refusals_total{{'kind': '{kind}'}}"] == 0.0
    assert seen["bpn_queue_runs"] == 1.0
    assert seen["bpn_workers_refused"] == seen["bpn_run_folders_unreadable"] == 0.0
    assert seen["bpn_registry_serving"] == 1.0
    program = f"{{'protocol': '{PROTOCOL}', 'version': '{version('bpn-shared')}'}}"
    assert seen[f"bpn_build_info{program}"] == 1.0
    for folder in ("runs", "state"):
        free, size = (seen[f"bpn_disk_{w}_bytes{{'folder': '{folder}'}}"] for w in ("free", "size"))
        assert 0 < free < size


def test_a_run_has_samples_while_it_is_worked_on(
    client: TestClient, context: Context, store: RunStore
) -> None:
    row = store.create(RunConfig(iterations=7), actor="test")
    labels = f"'run': '{row.id}', 'task': 'reaching'"
    assert not any(labels in name for name in samples(client))  # the queue may be long

    now_s = time.time()
    context.registry = lambda: RegistryView(
        {row.id: frozenset({"place", "disk"})}, {row.id: now_s - 50}
    )
    seen_now: dict[str, Any] = {"state": "running", "iteration": 3}
    stalled = {"waiting_reason": "1 edge missing: none", "waiting_since": now_s - 40}
    store.observe({row.id: seen_now | stalled})
    seen = samples(client)
    assert (
        seen[
            f"bpn_run_state{{{labels[: labels.index(',')]}, 'state': 'running', 'task': 'reaching'}}"
        ]
        == 1
    )
    assert seen[f"bpn_run_iteration{{{labels}}}"] == 3
    assert seen[f"bpn_run_iterations{{{labels}}}"] == 7
    assert 50 <= seen[f"bpn_run_iteration_age_seconds{{{labels}}}"] < 80
    assert seen[f"bpn_run_stalled{{{labels}}}"] == 1
    assert 40 <= seen[f"bpn_run_waiting_seconds{{{labels}}}"] < 70
    reasons = {name for name in seen if name.startswith("bpn_run_waiting{")}
    assert {re.search(r"'reason': '(\w+)'", name)[1] for name in reasons} == {"place", "disk"}  # type: ignore[index]
    assert seen["bpn_runs_waiting{'reason': 'disk'}"] == 1
    assert "1 edge missing" not in client.get("/metrics").text  # free text would be without bounds

    context.registry = RegistryView
    store.observe({row.id: {"waiting_reason": "", "waiting_since": None}})
    assert samples(client)[f"bpn_run_stalled{{{labels}}}"] == 0
    store.observe({row.id: {"state": "finished"}})
    assert not any(row.id in name for name in samples(client))


def test_of_very_many_runs_the_newest_have_samples_and_all_are_counted(
    client: TestClient, store: RunStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "MOST_RUNS", 2)
    rows = [store.create(RunConfig(), actor="test") for _ in range(4)]
    store.observe({row.id: {"state": "running"} for row in rows})
    seen = samples(client)
    assert seen["bpn_runs{'state': 'running'}"] == 4
    assert sum(name.startswith("bpn_run_iteration{") for name in seen) == 2


def test_workers_are_counted_by_kind_and_each_tells_how_it_is(
    client: TestClient, context: Context, topology: Topology
) -> None:
    run = "0198c0de-0000-7000-8000-000000000001"
    counters = {"frames_refused": 2, "episodes_stored": 9}
    topology.hear(report("edge-1", run=run, slot=3, counters=counters, waiting_for="a frame",
                         waiting_s=4.0, refusals={"frames_refused": "too long"}))  # fmt: skip
    for other in ("edge-2", "learner-1", "robot-sim-1", "dashboard-1"):
        topology.hear(report(other))
    topology.token("bpn/live/robot_sim/robot-sim-1", alive=False)
    context.refused = lambda: [Refused("edge", "edge-2", "old", 0.0)]
    context.registry = lambda: RegistryView(vacant={"robot_sim": 2})
    context.counters.refuse("live_refused", "no message")
    seen = samples(client)
    counted = {name: value for name, value in seen.items() if name.startswith("bpn_workers{")}
    assert {name for name, value in counted.items() if value} == {
        "bpn_workers{'kind': 'edge', 'state': 'working'}",
        "bpn_workers{'kind': 'learner', 'state': 'idle'}",
    }
    assert seen["bpn_workers_refused"] == 1
    assert seen["bpn_places_vacant{'kind': 'robot_sim'}"] == 2
    assert seen["bpn_refusals_total{'kind': 'edge'}"] == 2
    assert seen["bpn_refusals_total{'kind': 'dashboard'}"] == 1
    edge = "'kind': 'edge', 'worker': 'edge-1'"
    refused = f"{{'counter': 'frames_refused', {edge}}}"
    assert seen[f"bpn_worker_refusals_total{refused}"] == 2
    assert seen[f"bpn_worker_resident_memory_bytes{{{edge}}}"] == 2**20
    assert 4 <= seen[f"bpn_worker_waiting_seconds{{{edge}}}"] < 30
    assert 0 <= seen[f"bpn_worker_report_age_seconds{{{edge}}}"] < 30
    (info,) = (n for n in seen if n.startswith("bpn_worker_info{") and "edge-1" in n)
    for told in ("'host': 'cell'", f"'run': '{run}'", "'slot': '3'", "'version': '1.2'"):
        assert told in info
    assert not any("robot-sim-1" in name for name in seen)  # it is gone


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 5), st.booleans()), min_size=1, max_size=40
    )
)
def test_totals_of_refusals_never_fall_and_count_everything_once(
    steps: list[tuple[int, int, bool]],
) -> None:
    """Workers refuse, are replaced by new ones, and are heard of again and again."""
    totals, told, expected = RefusalTotals(), 0, 0
    lives = dict.fromkeys(range(4), 0)
    last: dict[int, Telemetry] = {}
    counts = dict.fromkeys(range(4), 0)
    for worker, more, restarts in steps:
        if restarts:
            lives[worker] += 1
            counts[worker] = 0
            last.pop(worker, None)
        counts[worker] += more
        expected += more
        now = report(f"edge-{worker}{lives[worker]}", counters={"frames_refused": counts[worker]},
                     refusals={"frames_refused": "x"})  # fmt: skip
        totals.take(last.get(worker), now)
        last[worker] = now
        assert totals.by_kind()["edge"] >= told
        told = totals.by_kind()["edge"]
    assert told == expected


def test_what_was_refused_before_anybody_counted_is_no_news() -> None:
    totals = RefusalTotals()
    known = {"counters": {"frames_refused": 50}, "refusals": {"frames_refused": "x"}}
    totals.take(None, report("edge-1", uptime_s=3600.0, **known))
    assert totals.by_kind().get("edge", 0) == 0


def test_certificates_tell_their_days_and_the_first_to_end_comes_first(
    client: TestClient, context: Context, topology: Topology
) -> None:
    now = datetime.now(UTC)
    router = Certificate("router", "", Life(now - 300 * DAY, now + 65 * DAY))
    context.certificates = lambda: [router, Certificate("web", "", Life(now - DAY, now - DAY / 2))]
    start_s, end_s = ((now + days * DAY).timestamp() for days in (-345, 20))
    life = CertificateLife(start_unix_s=start_s, end_unix_s=end_s)
    topology.hear(report("edge-1", certificate=life))
    topology.hear(report("edge-2"))  # it has none
    seen = samples(client)
    edge = "{'kind': 'edge', 'worker': 'edge-1'}"
    assert 19.9 < seen[f"bpn_certificate_days_left{edge}"] <= 20
    assert seen[f"bpn_certificate_life_days{edge}"] == pytest.approx(365)
    assert -0.6 < seen["bpn_certificate_days_left{'kind': 'web', 'worker': ''}"] <= -0.5
    told = client.get("/api/v1/system/status").json()["certificates"]
    assert [(c["kind"], c["id"], c["near_end"]) for c in told] == [
        ("web", "", True), ("edge", "edge-1", True), ("router", "", False),
    ]  # fmt: skip
    assert told[2]["end_unix_s"] == pytest.approx(router.life.end.timestamp())


def _rows(context: Context) -> Iterator[str]:
    for family in Families(context).collect():
        labels = ", ".join(f"`{name}`" for name in family._labelnames) or " "
        suffix = {"counter": "_total", "info": "_info"}.get(family.type, "")
        if family.type == "info":
            labels = "`protocol`, `version`"
        kind = "gauge" if family.type == "info" else family.type
        yield f"| `{family.name}{suffix}` | {kind} | {labels} | {family.documentation} |"


def test_the_page_lists_every_metric(context: Context) -> None:
    page = [" ".join(line.split()) for line in PAGE.read_text().splitlines()]
    listed = [line for line in page if re.match(r"\| `bpn_\w+` \| (gauge|counter) \|", line)]
    assert listed == [" ".join(row.split()) for row in _rows(context)]
