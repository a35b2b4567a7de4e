"""Whatever lies in the runs folder: the other runs are shown, and what is not is named with the reason."""

import json
import os
import shutil
import time
from pathlib import Path
from uuid import UUID

import pytest
from fastapi.testclient import TestClient

from bpn_dashboard.api.context import Context
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series.ingest import Ingest
from bpn_shared.counters import Counters
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.state import encode_state
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching", seed=3, hidden_units=24)
GOOD, ODD = UUID(int=0xABC), UUID(int=0xDEF)
RECORD = {"iteration": 0, "return_px": -5.0, "length": 20.0, "weights_version": 1}
ODD_LINES = [
    b'{"a":' * 5000,
    b'{"iteration": "x", "return_px": 1.0, "length": 1.0, "weights_version": 1}',
    b'{"iteration": 1, "return_px": ' + b"9" * 401 + b', "length": 1.0, "weights_version": 1}',
    b'{"iteration": 1, "return_px": 1.0, "length": 1.0, "weights_version": 1180591620717411303424}',
    b'{"iteration": 1, "return_px": 1.0, "length": [1], "weights_version": 1}',
    b'{"iteration": 1180591620717411303424, "return_px": 1, "length": 1, "weights_version": 1}',
    b"\xff\x00\xfe", b"{}", b"12", b"null", b'{"iteration": 1}', b'"\\ud800"',
]  # fmt: skip


def ids(store: RunStore) -> list[str]:
    return [row.id for row in store.find(RunFilter(archived=None))]


@pytest.mark.parametrize("line", ODD_LINES, ids=range(len(ODD_LINES)))
def test_an_odd_line_of_metrics_disturbs_no_run(
    store: RunStore, context: Context, line: bytes
) -> None:
    good = RunFolder.create(store.runs_dir, GOOD, CONFIG)
    odd = RunFolder.create(store.runs_dir, ODD, CONFIG)
    good.append_metrics(RECORD)
    (odd.path / "metrics.jsonl").write_bytes(line + b"\n" + json.dumps(RECORD).encode() + b"\n")
    store.adopt()
    assert ids(store) == [str(GOOD), str(ODD)]
    for run in (GOOD, ODD):
        assert store.get(str(run)).return_last in (-5.0, None)
    assert context.ingest.poll() >= 6  # three of each run's good line


@pytest.mark.parametrize("order", [("config.json", "state.json"), ("state.json", "config.json")])
def test_a_folder_that_is_looked_at_too_early_appears_when_it_is_whole(
    store: RunStore, tmp_path: Path, order: tuple[str, str]
) -> None:
    source = RunFolder.create(tmp_path / "elsewhere", GOOD, CONFIG).path
    target = store.runs_dir / source.name
    target.mkdir(parents=True)
    for name in order:
        store.adopt()
        assert ids(store) == []
        assert "is not there, or not yet" in store.index.unreadable()[source.name]
        shutil.copy(source / name, target / name)
    store.adopt()
    assert ids(store) == [source.name]
    assert store.index.unreadable() == {}


@pytest.mark.parametrize("name", ["config.json", "state.json", "about.json"])
@pytest.mark.parametrize("damage", [b"", b"{", b"[1]", b"\xff", b'{"a":' * 5000])
def test_a_damaged_folder_is_named_and_appears_when_it_is_mended(
    store: RunStore, name: str, damage: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    RunFolder.create(store.runs_dir, GOOD, CONFIG)
    odd = RunFolder.create(store.runs_dir, ODD, CONFIG)
    file = odd.path / name
    right = file.read_bytes() if file.exists() else b'{"name": "mine"}'
    file.write_bytes(damage)
    for _ in range(3):
        store.adopt()
        assert ids(store) == [str(GOOD)]
    assert name in store.index.unreadable()[str(ODD)]
    said = [record for record in caplog.records if str(ODD) in record.getMessage()]
    assert len(said) == 1  # once, not at every look
    file.write_bytes(right)
    store.adopt()
    assert ids(store) == [str(GOOD), str(ODD)]
    assert store.index.unreadable() == {}


def test_a_run_of_a_newer_version_is_shown_as_far_as_it_can_be_and_not_given_to_workers(
    store: RunStore,
) -> None:
    folder = RunFolder.create(store.runs_dir, ODD, CONFIG)
    file = folder.path / "config.json"
    right = file.read_bytes()
    newer = CONFIG.model_dump() | {"horizon": 7, "hidden_units": 25}
    file.write_text(json.dumps(newer))
    (folder.path / "about.json").write_text('{"desired_state": "running", "colour": "red"}')
    (row,) = store.find() or store.index.adopt()
    assert (row.task, row.config["horizon"], row.desired_state) == ("reaching", 7, "stopped")
    assert "horizon" in row.error
    assert "horizon" in store.index.unreadable()[row.id]
    file.write_bytes(right)
    store.adopt()
    row = store.get(row.id)
    assert (row.config["hidden_units"], row.desired_state, row.error) == (24, "running", "")
    assert store.index.unreadable() == {}
    store.update(row.id, row.rev, name="mine", actor="a")
    about = json.loads((folder.path / "about.json").read_text())
    assert (about["name"], about["colour"]) == ("mine", "red")  # what it does not know stays


def test_copies_in_other_spellings_links_and_other_things_are_no_runs(store: RunStore) -> None:
    good = RunFolder.create(store.runs_dir, GOOD, CONFIG).path
    shutil.copytree(good, store.runs_dir / good.name.upper())
    (store.runs_dir / str(ODD)).symlink_to(good)
    (store.runs_dir / str(UUID(int=7))).write_text("no folder")
    (store.runs_dir / "notes").mkdir()
    for _ in range(2):
        store.adopt()
        assert ids(store) == [good.name]
    unreadable = store.index.unreadable()
    assert "in another spelling" in unreadable[good.name.upper()]
    assert "a link" in unreadable[str(ODD)]
    assert set(unreadable) == {good.name.upper(), str(ODD), str(UUID(int=7))}
    shutil.rmtree(store.runs_dir / good.name.upper())
    store.adopt()
    assert good.name.upper() not in store.index.unreadable()


def test_the_status_tells_what_is_not_shown(store: RunStore, client: TestClient) -> None:
    folder = RunFolder.create(store.runs_dir, ODD, CONFIG)
    (folder.path / "config.json").write_text("{")
    store.adopt()
    status = client.get("/api/v1/system/status").json()
    (unreadable,) = status["unreadable_folders"]
    assert unreadable["folder"] == str(ODD)
    assert "config.json" in unreadable["reason"]
    assert "bpn_run_folders_unreadable 1.0" in client.get("/metrics").text


def test_metrics_that_are_no_file_of_the_runs_own_are_counted_and_others_taken_in(
    store: RunStore, context: Context, tmp_path: Path
) -> None:
    good = RunFolder.create(store.runs_dir, GOOD, CONFIG)
    odd = RunFolder.create(store.runs_dir, ODD, CONFIG)
    good.append_metrics(RECORD)
    (tmp_path / "secret").write_text(json.dumps(RECORD) + "\n")
    os.symlink(tmp_path / "secret", odd.path / "metrics.jsonl")
    counters = Counters()
    ingest = Ingest(store.runs_dir, context.database, counters)
    assert ingest.poll() == 3  # of the good one
    assert counters.snapshot()["metrics_files_refused"] == 1


def test_nobody_changes_what_another_dashboard_serves(
    context: Context, client: TestClient, store: RunStore
) -> None:
    row = store.create(CONFIG, actor="a")
    sentence = "another dashboard (host, pid 12) serves this router: read-only"
    store._read_only = lambda: sentence
    context.read_only = context.obstacle = lambda: sentence
    answers = [
        client.post("/api/v1/runs", json={"config": {"task": "reaching"}}),
        client.post(f"/api/v1/runs/{row.id}/stop"),
        client.patch(f"/api/v1/runs/{row.id}", json={"name": "x"}, headers={"If-Match": "*"}),
        client.post("/api/v1/sweeps", json={"name": "s", "config": {"task": "reaching"}, "seeds": [1]}),
    ]  # fmt: skip
    for answer in answers:
        assert (answer.status_code, answer.json()["detail"]) == (409, sentence)
        assert answer.json()["type"] == "urn:bpn:problem:read-only"
    assert ids(store) == [row.id]
    assert [path.name for path in store.runs_dir.glob("*/config.json")] == ["config.json"]
    assert client.get("/api/v1/system/status").json()["read_only"] == sentence
    context.ingest.start()
    assert client.get("/readyz").json()["detail"] == sentence
    context.ingest.close()
    assert client.get(f"/api/v1/runs/{row.id}").status_code == 200


def test_a_copied_run_changed_when_its_state_says(store: RunStore) -> None:
    """Not when it was copied; and a run of a clock that goes fast is no newer than now."""
    folder = RunFolder.create(store.runs_dir, GOOD, CONFIG)
    told = folder.state()
    (folder.path / "state.json").write_bytes(
        encode_state(told.model_copy(update={"created_unix_s": 1e9, "updated_unix_s": 1.5e9}))
    )
    early = RunFolder.create(store.runs_dir, ODD, CONFIG)
    ahead_s = time.time() + 86_400.0
    ahead = told.model_copy(update={"created_unix_s": ahead_s, "updated_unix_s": ahead_s})
    (early.path / "state.json").write_bytes(encode_state(ahead))
    store.adopt()
    copied, future = store.get(str(GOOD)), store.get(str(ODD))
    assert (copied.created_at, copied.updated_at) == (1e9, 1.5e9)
    assert future.created_at <= time.time() >= future.updated_at
    assert store.changed_folders() == []  # nothing is news


def test_an_iteration_without_a_number_counts_and_has_none(store: RunStore) -> None:
    """A learning that diverged goes on: nothing is shown that was true some iterations ago."""
    folder = RunFolder.create(store.runs_dir, GOOD, CONFIG)
    for iteration, value in enumerate([-5.0, -3.0, None]):
        folder.append_metrics(
            RECORD | {"iteration": iteration, "return_px": value, "length": value}
        )
    store.adopt()
    run = store.get(str(GOOD))
    assert (run.iteration, run.return_best) == (3, -3.0)
    assert (run.return_last, run.return_mean_last_5, run.length_last) == (None, None, None)
