"""A learner that was taken over writes run folders: what it plants there leads the dashboard nowhere."""

import json
import os
import shutil
from pathlib import Path
from types import SimpleNamespace
from uuid import UUID

import numpy as np
import orjson
import pytest

from bpn_dashboard.hub.log_tail import LogTail
from bpn_dashboard.registry.about import About
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig

pytestmark = pytest.mark.timeout(60)  # a pipe that blocks is a failure

SECRET = "stolen"
FILES = (
    "config.json", "state.json", "about.json", "metrics.jsonl", "rewards.jsonl",
    "environment.jsonl", "checkpoint.safetensors", "logs/learner.log", "weights/000000.bpnw",
    "exports/policy.onnx", "episodes/000000-00000.bpne",
)  # fmt: skip
FOLDERS = ("logs", "weights", "exports", "episodes")


def fill(folder: RunFolder, word: str) -> None:
    """Every file that a run has, each with a word by which it is known again."""
    config = RunConfig.for_task("reaching", episodes=1, steps=2, hidden_units=8, seed=len(word))
    return_px = b"-77.5" if word == SECRET else b"-5.5"
    line = f"2026-11-22T08:00:00.000Z learner INFO {word}\n"
    blob = WeightBlob.random(config.network, np.random.default_rng(len(word)))
    episode = Episode(
        meta=EpisodeMeta(
            iteration=0, episode=0, seed=1, slot=0, worker=word, weights_attempt=1,
            weights_version=0, terminated=False, deadline_misses=0, duration_ns=5,
        ),
        frames=np.zeros((3, 1, 84, 84), np.uint8),
        actions=np.zeros(2, np.uint8),
        rewards=np.zeros(2),
        outputs=np.zeros((2, 14), np.int32),
        inference_ns=np.zeros(2, np.uint32),
        camera_to_action_ns=np.zeros(2, np.uint32),
    )  # fmt: skip
    contents = {
        "config.json": config.model_dump_json().encode(),
        "state.json": b'{"state": "failed", "error": "%s"}' % word.encode(),
        "about.json": About(name=word).model_dump_json().encode(),
        "metrics.jsonl": b'{"iteration": 0, "%s": 1, "return_px": %s}\n'
        % (word.encode(), return_px),
        "rewards.jsonl": b'{"iteration": 0, "rewards_px": [[%s, %s]]}\n' % (return_px, return_px),
        "environment.jsonl": b'{"attempt": 1, "worker": "%s", "time_unix_s": 1.0}\n'
        % word.encode(),
        "checkpoint.safetensors": word.encode(),
        "logs/learner.log": line.encode(),
        "weights/000000.bpnw": blob.encode(),
        "exports/policy.onnx": word.encode(),
        "episodes/000000-00000.bpne": episode.encode(),
    }
    assert set(contents) == set(FILES)
    for name, data in contents.items():
        path = folder.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


@pytest.fixture
def planted(store, tmp_path) -> SimpleNamespace:
    """A run with all files, and somebody else's folder with the same ones, which tell a secret."""
    row = store.create(
        RunConfig.for_task("reaching", episodes=1, steps=2, hidden_units=8), actor="test"
    )
    folder, elsewhere = store.folder(row.id), RunFolder(tmp_path / "elsewhere" / str(UUID(int=7)))
    fill(folder, "our-own")
    fill(elsewhere, SECRET)
    return SimpleNamespace(id=row.id, folder=folder, elsewhere=elsewhere)


def routes(run_id: str) -> list[str]:
    """Every operation that reads a run's folder."""
    run = f"/api/v1/runs/{run_id}"
    artefacts = (
        "weights.000000", "checkpoint.checkpoint", "config.config", "metrics.metrics", "log.learner",
        "onnx.policy",
    )  # fmt: skip
    return [
        "/api/v1/runs", run, f"{run}/artefacts", f"{run}/logs", f"{run}/episodes", f"{run}/environment",
        f"{run}/episodes?iteration=0", f"{run}/episodes/0/0", f"{run}/episodes/0/0/frames",
        f"/api/v1/series/export?run={run_id}&metrics=return_px",
        *(f"/api/v1/artefacts/{run_id}.{artefact}" for artefact in artefacts),
    ]  # fmt: skip


def check_nothing_leaks(client, planted, context) -> None:
    context.ingest.poll()
    context.runs.index.adopt()
    stolen = [(planted.elsewhere.path / name).read_bytes() for name in FILES]
    for url in routes(planted.id):
        answer = client.get(url)
        assert answer.status_code < 500, (url, answer.text)
        assert SECRET.encode() not in answer.content, url
        assert answer.content not in stolen, url
        assert b"-77.5" not in answer.content, url
    entries = LogTail(planted.folder.logs, planted.folder.path.parent).new_entries()
    assert SECRET not in str(entries)
    body = {"runs": [planted.id], "metrics": [SECRET]}
    (curve,) = client.post("/api/v1/series/query", json=body).json()["series"]
    assert curve["value"] == []


def test_a_run_without_links_is_served(client, planted, context) -> None:
    """Or the tests below would show nothing."""
    context.ingest.poll()
    for url in routes(planted.id):
        if "export" not in url:
            assert client.get(url).status_code == 200 or "frames" in url, url
    assert b"our-own" in client.get(f"/api/v1/runs/{planted.id}/logs").content
    assert len(LogTail(planted.folder.logs, planted.folder.path.parent).new_entries()) == 1


@pytest.mark.parametrize("name", FILES)
def test_linked_files_are_not_read(client, planted, context, name) -> None:
    (planted.folder.path / name).unlink()
    (planted.folder.path / name).symlink_to(planted.elsewhere.path / name)
    check_nothing_leaks(client, planted, context)


@pytest.mark.parametrize("name", FILES)
def test_pipes_make_nobody_wait(client, planted, context, name) -> None:
    (planted.folder.path / name).unlink()
    os.mkfifo(planted.folder.path / name)
    check_nothing_leaks(client, planted, context)


@pytest.mark.parametrize("name", FOLDERS)
def test_linked_folders_are_not_read(client, planted, context, name) -> None:
    shutil.rmtree(planted.folder.path / name)
    (planted.folder.path / name).symlink_to(planted.elsewhere.path / name)
    check_nothing_leaks(client, planted, context)


def test_a_folder_that_became_a_link_is_not_read(client, planted, context) -> None:
    shutil.rmtree(planted.folder.path)
    planted.folder.path.symlink_to(planted.elsewhere.path)
    check_nothing_leaks(client, planted, context)


def test_a_linked_run_folder_is_not_adopted(client, planted, store, context) -> None:
    linked = store.runs_dir / planted.elsewhere.path.name
    linked.symlink_to(planted.elsewhere.path)
    check_nothing_leaks(client, planted, context)
    assert client.get(f"/api/v1/runs/{linked.name}").status_code == 404


def test_a_linked_sweep_is_not_read(planted, store) -> None:
    sweeps = store.runs_dir / "sweeps"
    sweeps.mkdir(exist_ok=True)
    sweep = {"id": SECRET, "name": SECRET, "config": {}, "grid": {}, "seeds": [], "created_at": 1}
    elsewhere = planted.elsewhere.path / "sweep.json"
    elsewhere.write_text(json.dumps(sweep))
    (sweeps / f"{UUID(int=9)}.json").symlink_to(elsewhere)
    assert store.index.rebuild().sweeps == 0


@pytest.mark.parametrize("name", ["about.json", "about.json.new", "state.json", "state.json.new"])
def test_changes_do_not_write_through_links(client, planted, name) -> None:
    precious = planted.elsewhere.path / "precious"
    precious.write_text("precious")
    path = planted.folder.path / name
    path.unlink(missing_ok=True)
    path.symlink_to(precious)
    run = f"/api/v1/runs/{planted.id}"
    answer = client.patch(run, json={"notes": "changed"}, headers={"If-Match": "*"})
    assert answer.status_code == 200
    assert client.post(f"{run}/stop").status_code == 200
    assert precious.read_text() == "precious"
    assert About.read(planted.folder).notes == "changed"


def test_changes_do_not_reach_a_folder_elsewhere(client, planted) -> None:
    shutil.rmtree(planted.folder.path)
    planted.folder.path.symlink_to(planted.elsewhere.path)
    before = {path: path.stat().st_mtime_ns for path in planted.elsewhere.path.rglob("*")}
    answer = client.patch(
        f"/api/v1/runs/{planted.id}", json={"notes": "changed"}, headers={"If-Match": "*"}
    )
    assert answer.status_code in (409, 422, 507)
    assert client.get(f"/api/v1/runs/{planted.id}").json()["notes"] == ""
    assert before == {path: path.stat().st_mtime_ns for path in planted.elsewhere.path.rglob("*")}


def test_files_of_other_programs_disturb_no_page(client, planted, tmp_path: Path) -> None:
    odd = (
        "weights/abc.bpnw", "weights/٣.bpnw", "weights/7.bpnw", "episodes/copy of.bpne",
        "episodes/999999999999-0.bpne", "logs/größe.log", "logs/a\nb.log", "logs/" + "x" * 200 + ".log",
        "exports/€.onnx", "logs/\udcff.log",
    )  # fmt: skip
    for name in odd:
        (planted.folder.path / name).write_bytes(b"2026-11-22T08:00:00.000Z x INFO y\n")
    (planted.folder.logs / "gone.log").symlink_to(tmp_path / "gone")
    for url in routes(planted.id):
        assert client.get(url).status_code < 500, url
    listed = client.get(f"/api/v1/runs/{planted.id}/artefacts").json()["items"]
    assert {"größe.log", "€.onnx", "7.bpnw"} <= {item["name"] for item in listed}
    for item in listed:
        answer = client.get(f"/api/v1/artefacts/{item['id']}")
        assert (answer.status_code, len(answer.content)) == (200, item["size_bytes"]), item["name"]
    episodes = client.get(f"/api/v1/runs/{planted.id}/episodes").json()
    assert (episodes["last_iteration"], len(episodes["items"])) == (0, 1)


@pytest.mark.parametrize(
    "record",
    [
        {"iteration": 0, "returns_px": 7}, {"iteration": 0, "returns_px": ["x"]},
        {"iteration": 0, "returns_px": {"0": 1}}, {"iteration": 0, "rewards_px": [7]},
        {"iteration": 0, "rewards_px": [["x", {}]]}, {"iteration": 0, "rewards_px": [[1]]},
        {"iteration": 0, "returns_px": None},
    ],
)  # fmt: skip
def test_records_of_another_form_disturb_no_page(client, planted, record) -> None:
    for name in ("metrics.jsonl", "rewards.jsonl"):
        (planted.folder.path / name).write_text(json.dumps(record) + "\n")
    url = f"/api/v1/runs/{planted.id}/episodes"
    (item,) = client.get(url).json()["items"]
    assert item["episode_return"] is None
    (planted.folder.path / "weights/000000.bpnw").write_bytes(
        WeightBlob.random(planted.folder.config().network, np.random.default_rng(0)).encode()
    )
    assert client.get(f"{url}/0/0").json()["rewards"] is None


def test_long_lines_are_read_once_each(client, planted) -> None:
    lines = [f"2026-11-22T08:00:0{n}.000Z learner INFO {str(n) * n * 200_000}" for n in range(1, 8)]
    (planted.folder.logs / "learner.log").write_text("\n".join(lines) + "\n")
    items = client.get(f"/api/v1/runs/{planted.id}/logs").json()["items"]
    starts = [item["message"][0] for item in items]
    assert starts == list("7654321")
    assert max(len(orjson.dumps(item)) for item in items) < 100_000


def test_an_unreadable_folder_says_so(planted) -> None:
    shutil.rmtree(planted.folder.path)
    planted.folder.path.symlink_to(planted.elsewhere.path)
    with pytest.raises(ConfigError):
        About.read(planted.folder)
