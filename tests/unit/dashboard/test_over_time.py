"""Services over time, sizes of runs, and where attempts were made."""

import time
from typing import Any
from uuid import UUID

import pytest

from bpn_dashboard.database.engine import Database
from bpn_dashboard.hub import samples as samples_module
from bpn_dashboard.hub.samples import KEPT_S, PERIOD_S, Samples
from bpn_dashboard.hub.topology import Flow, Node, TopologySnapshot
from bpn_dashboard.registry.disk_usage import DiskUsage
from bpn_dashboard.registry.store import RunStore
from bpn_shared.runs.environment import FILE, Environment, read_environments, write_environment
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching")


def snapshot(
    cpu_percent: float, *, state: str = "live", run: str | None = None, worker: str = "edge-1"
) -> TopologySnapshot:
    flow = Flow(
        key="k", direction="sent", messages=9, bytes=9, dropped=1,
        messages_per_s=3.0, bytes_per_s=3.0, dropped_per_s=0.5,
    )  # fmt: skip
    service = Node(
        kind="edge", id=worker, state=state, age_s=0.1, run=run, slot=0, host="h",
        cpu_percent=cpu_percent, rss_bytes=1000, flows=[flow, flow],
    )  # fmt: skip
    return TopologySnapshot(time_unix_s=0.0, nodes=[service], links=[])


def test_services_are_seen_as_they_were(database: Database, client: Any) -> None:
    now_s = int(time.time()) // 60 * 60
    shown = [snapshot(0.0)]
    samples = Samples(database, lambda: shown[0])
    for i in range(40):
        shown[0] = snapshot(float(i), run="r" if i > 20 else None)
        assert samples.take(now_s - (40 - i) * PERIOD_S) == 1
    shown[0] = snapshot(99.0, state="stale")
    assert samples.take(now_s) == 0  # of whom nothing is heard now, nothing is known
    [fine] = samples.read(now_s - 3600, 1000)
    assert (fine.kind, fine.run, fine.host, len(fine.at)) == ("edge", "r", "h", 40)
    assert fine.at == sorted(fine.at)
    assert fine.cpu_percent == [float(i) for i in range(40)]
    assert (set(fine.messages_per_s), set(fine.dropped_per_s)) == ({6.0}, {1.0})
    [coarse] = samples.read(now_s - 3600, 30)
    assert len(coarse.at) < 30
    assert min(coarse.cpu_percent) >= 0
    assert max(coarse.cpu_percent) <= 39
    told = client.get("/api/v1/system/history", params={"seconds": 3600}).json()["services"]
    assert [service["worker"] for service in told] == ["edge-1"]
    assert client.get("/api/v1/system/history", params={"seconds": 0}).status_code == 422


def test_samples_are_bounded(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples_module, "_TIDY_EVERY", 1)
    monkeypatch.setattr(samples_module, "MOST_ROWS", 5)
    samples = Samples(database, lambda: snapshot(1.0))
    now_s = time.time()
    samples.take(now_s - KEPT_S - 100)
    samples.take(now_s - 1000)
    assert len(samples.read(0, 2000)[0].at) == 1  # the one too old is gone
    for i in range(20):
        samples.take(now_s - 500 + i * PERIOD_S)
    [left] = samples.read(now_s - 2000, 2000)
    assert 5 <= len(left.at) <= 6


def test_of_many_services_those_that_were_there_last_are_told(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples_module, "MOST_SERVICES", 3)
    shown = [snapshot(0.0)]
    samples, now_s = Samples(database, lambda: shown[0]), int(time.time())
    for i in range(5):  # each restart is another service
        shown[0] = snapshot(1.0, worker=f"edge-{i}")
        for second in range(2):
            samples.take(now_s - 600 + 100 * i + second * PERIOD_S)
    found = samples.read(now_s - 3600, 1000)
    assert [one.worker for one in found] == ["edge-2", "edge-3", "edge-4"]
    assert {len(one.at) for one in found} == {2}


def test_runs_are_measured_when_they_changed(
    database: Database, store: RunStore, client: Any
) -> None:
    run = store.create(CONFIG, actor="a")
    folder = store.folder(run.id)
    (folder.path / "episodes").mkdir(exist_ok=True)
    (folder.path / "episodes" / "one").write_bytes(b"x" * 5000)
    usage = DiskUsage(database, store.runs_dir)
    [(due, changed_s)] = usage.due()
    before = store.get(run.id)
    size = usage.measure(due, changed_s)
    assert size == sum(f.stat().st_size for f in folder.path.rglob("*") if f.is_file()) > 5000
    measured = store.get(run.id)
    assert (measured.disk_bytes, measured.updated_at, measured.rev) == (
        size, before.updated_at, before.rev,
    )  # fmt: skip
    assert usage.due() == []
    assert (
        DiskUsage(database, store.runs_dir).due() == []
    )  # another life of the dashboard believes it
    store.observe({run.id: {"iteration": 1}})
    assert [due for due, _ in usage.due()] == [run.id]
    disk = client.get("/api/v1/system/disk").json()
    assert (disk["runs_bytes"], disk["runs_measured"]) == (size, 1)
    assert disk["total_bytes"] > disk["free_bytes"] > 0
    page = client.get("/api/v1/runs", params={"sort": "-disk_bytes"}).json()
    assert page["items"][0]["disk_bytes"] == size


def test_a_run_that_goes_while_it_is_measured_disturbs_nobody(
    database: Database, store: RunStore
) -> None:
    usage = DiskUsage(database, store.runs_dir)
    assert usage.measure(str(UUID(int=7)), 1.0) is None


def test_every_attempt_says_where_and_with_what_it_was_made(store: RunStore, client: Any) -> None:
    run = store.create(CONFIG, actor="a")
    url = f"/api/v1/runs/{run.id}/environment"
    assert client.get(url).json()["attempts"] == []  # of a version before
    folder = RunFolder(store.runs_dir / run.id)
    with folder.owned("learner-1") as owner:
        owner.begin_attempt()
        here = Environment.here(owner.attempt, "learner-1", "a GPU")
        write_environment(folder, here, prove=owner.prove)
    with (folder.path / FILE).open("ab") as file:
        file.write(b'{"attempt": 2, "cut by a cra')
    assert read_environments(folder) == [here]
    told = client.get(url).json()
    [attempt] = told["attempts"]
    assert (attempt["attempt"], attempt["worker"], attempt["accelerator"]) == (
        1,
        "learner-1",
        "a GPU",
    )
    assert attempt["packages"]["numpy"]
    assert attempt["command"]
    assert told["created"]["version"] == attempt["version"]
