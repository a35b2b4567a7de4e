"""What a run leaves behind, through HTTP: series, artefacts, episodes, logs."""

import csv
import hashlib
import io
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import orjson
import pyarrow.parquet as pq
import pytest
from fastapi import FastAPI, Request
from fastapi.testclient import TestClient
from paper import TASKS

from bpn_dashboard.api.files import file_response
from bpn_robot_sim.pan_tilt import geometry as pan_tilt
from bpn_robot_sim.reaching import geometry as reaching
from bpn_robot_sim.tracking import geometry as tracking
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.spec.config import RunConfig


@pytest.fixture
def run(store, context):
    """A run of two iterations with everything that a run has."""
    row = store.create(
        RunConfig.for_task("reaching", episodes=2, steps=3, hidden_units=8), actor="test"
    )
    folder = store.folder(row.id)
    rng = np.random.default_rng(0)
    for iteration in range(2):
        for episode in range(2):
            folder.episode_path(iteration, episode).write_bytes(
                Episode(
                    meta=EpisodeMeta(
                        iteration=iteration, episode=episode, seed=1, slot=0, worker="edge-1",
                        weights_attempt=1, weights_version=0, terminated=False, deadline_misses=0,
                        duration_ns=5,
                    ),
                    frames=rng.integers(0, 256, (4, 1, 84, 84), np.uint8),
                    actions=np.array([1, 2, 13], np.uint8),
                    rewards=np.full(3, np.nan),
                    outputs=rng.integers(-8, 9, (3, 14), np.int32),
                    inference_ns=np.array([1500, 2000, 2500], np.uint32),
                    camera_to_action_ns=np.array([300_000, 0, 400_000], np.uint32),
                ).encode()
            )  # fmt: skip
        folder.append_metrics(
            {"iteration": iteration, "return_px": -iteration - 1.5, "returns_px": [-1.0, -2.0],
             "time_unix_s": 100.0 + iteration}
        )  # fmt: skip
    rewards = {"iteration": 0, "rewards_px": [[-1, -2, -3], [-4, -5, -6]]}
    (folder.path / "rewards.jsonl").write_text(json.dumps(rewards) + "\n")
    context.ingest.poll()
    return SimpleNamespace(id=row.id, folder=folder, url=f"/api/v1/runs/{row.id}")


def test_curves_come_as_json_and_as_binary(client, run) -> None:
    body = {"runs": [run.id], "metrics": ["return_px", "nothing"], "x": "wall_s"}
    answer = client.post("/api/v1/series/query", json=body).json()
    curve, empty = answer["series"]
    assert (curve["x"], curve["value"], curve["low"]) == ([0, 1], [-1.5, -2.5], [None, None])
    assert (curve["run_ids"], empty["run_ids"], empty["x"]) == ([run.id], [], [])
    data = client.post(
        "/api/v1/series/query", json=body, headers={"Accept": "application/vnd.bpn.series"}
    ).content
    length = int.from_bytes(data[:4], "little")
    header = orjson.loads(data[4 : 4 + length])
    columns = np.frombuffer(data[4 + length :], "<f4").reshape(len(header["columns"]), -1)
    assert header["series"][0]["length"] == 2
    assert header["seq"] == answer["seq"]
    for name, column in zip(header["columns"], columns, strict=True):
        expected = np.array([np.nan if v is None else v for v in curve[name]], "f4")
        np.testing.assert_array_equal(column, expected)


def test_a_curve_is_as_far_as_the_row_that_was_announced(client, store, context) -> None:
    store.audience.subscribe(context.ingest.take_in)
    row = store.create(RunConfig.for_task("reaching"), actor="test")
    context.ingest.poll()  # it looks for new files again in two seconds
    store.folder(row.id).append_metrics({"iteration": 0, "return_px": -1.5})
    store.update(row.id, row.rev, notes="something changed", actor="test")
    body = {"runs": [row.id], "metrics": ["return_px"]}
    (curve,) = client.post("/api/v1/series/query", json=body).json()["series"]
    assert curve["value"] == [-1.5]


@pytest.mark.parametrize(
    "body",
    [
        {"metrics": ["loss"]},
        {"metrics": ["loss"], "runs": [], "filter": {}},
        {"metrics": [], "filter": {}},
        {"metrics": ["loss"], "filter": {}, "range": [1]},
        {"metrics": ["loss"], "filter": {}, "max_points": 0},
        {"metrics": ["loss"], "filter": {}, "group_by": ["nope"]},
        {"metrics": ["loss"], "filter": {"nope": "1"}},
    ],
)
def test_wrong_series_queries_are_refused(client, body) -> None:
    assert client.post("/api/v1/series/query", json=body).status_code == 422


def test_groups_are_named_by_what_differs(client, store, context) -> None:
    for alpha, seed in ((0.5, 0), (0.5, 1), (0.9, 0)):
        row = store.create(RunConfig.for_task("reaching", alpha=alpha, seed=seed), actor="test")
        store.folder(row.id).append_metrics({"iteration": 0, "return_px": -alpha - seed})
    context.ingest.poll()
    body = {"filter": {}, "metrics": ["return_px"]}
    groups = client.post("/api/v1/series/query", json=body).json()["series"]
    assert [(g["label"], g["value"], g["n"]) for g in groups] == [
        ("alpha=0.5", [-1.0], [2.0]), ("alpha=0.9", [-0.9], [1.0]),
    ]  # fmt: skip
    one = client.post("/api/v1/series/query", json=body | {"filter": {"config.alpha": "0.5"}})
    assert one.json()["series"][0]["key"] == groups[0]["key"]
    assert one.json()["series"][0]["value"] == groups[0]["value"]
    cells = client.get("/api/v1/heatmap?x=alpha&y=task&value=best_mean").json()["cells"]
    assert [(c["x"], c["n"], c["mean"]) for c in cells] == [(0.5, 2, -1.0), (0.9, 1, -0.9)]
    assert cells[0]["std"] == pytest.approx(np.std([-0.5, -1.5], ddof=1))
    assert cells[1]["std"] is None


def test_series_are_exported_whole(client, run, store, context) -> None:
    other = store.create(RunConfig.for_task("reaching"), actor="test")
    store.folder(other.id).append_metrics({"iteration": 7, "gone": 1})
    context.ingest.take_in([other])
    query = {"runs": run.id, "metrics": "return_px"}
    one = client.get("/api/v1/series/export", params=query | {"metrics": "gone"})
    assert one.status_code == 422  # of this run, that is
    both = client.get(
        "/api/v1/series/export",
        params={"runs": f"{run.id},{other.id}", "metrics": "return_px,gone"},
    )
    assert both.text.splitlines()[-1].endswith(",7,,1.0")
    rows = list(csv.DictReader(client.get("/api/v1/series/export", params=query).text.splitlines()))
    assert [(r["iteration"], r["return_px"]) for r in rows] == [("0", "-1.5"), ("1", "-2.5")]
    parquet = client.get("/api/v1/series/export", params=query | {"format": "parquet"})
    table = pq.read_table(io.BytesIO(parquet.content)).to_pydict()
    assert (table["iteration"], table["return_px"]) == ([0, 1], [-1.5, -2.5])


def test_no_name_is_a_formula_in_a_spreadsheet(client, run, store) -> None:
    names = ['=HYPERLINK("http://evil","x")', "+1", "-1", "@a", "\t=1", "a=1", "größe"]
    for name in names:
        row = store.get(run.id)
        store.update(run.id, row.rev, name=name, actor="test")
        query = {"runs": run.id, "metrics": "return_px"}
        text = client.get("/api/v1/series/export", params=query).text
        shown = {row["name"] for row in csv.DictReader(io.StringIO(text))}
        assert shown == {name if name in ("a=1", "größe") else f"'{name}"}


@pytest.mark.parametrize(
    "metrics", ["nonsense", "return_px,nonsense", "return_px,return_px", "seed"]
)
def test_exports_have_each_metric_once_and_no_other(client, run, metrics) -> None:
    for form in ("csv", "parquet"):
        query = {"runs": run.id, "metrics": metrics, "format": form}
        answer = client.get("/api/v1/series/export", params=query)
        assert answer.status_code == 422
        assert metrics.split(",")[-1] in answer.json()["detail"]


@pytest.mark.parametrize(
    "header", ["bytes=0-" + "9" * 5000, "bytes=" + "9" * 5000 + "-", "bytes=-" + "9" * 5000, "bytes=٣-",
               "bytes=-", "bytes=0-0,2-3", "\xff"],
)  # fmt: skip
def test_odd_ranges_are_the_whole_file(client, run, header) -> None:
    url = f"/api/v1/artefacts/{run.id}.metrics.metrics"
    answer = client.get(url, headers={"Range": header.encode()})
    assert (answer.status_code, answer.content) == (200, client.get(url).content)


def test_returns_of_gym_tasks_are_listed(client, run) -> None:
    record = {"iteration": 1, "return": 4.5, "returns": [4, 5]}
    (run.folder.path / "metrics.jsonl").write_text(json.dumps(record) + "\n")
    items = client.get(f"{run.url}/episodes", params={"iteration": 1}).json()["items"]
    assert [item["episode_return"] for item in items] == [4, 5]


def test_artefacts_are_downloaded_by_id(client, run) -> None:
    items = client.get(f"{run.url}/artefacts").json()["items"]
    assert {item["kind"] for item in items} == {"config", "metrics"}
    item = next(item for item in items if item["kind"] == "metrics")
    data = (run.folder.path / "metrics.jsonl").read_bytes()
    url = f"/api/v1/artefacts/{item['id']}"
    answer = client.get(url)
    assert answer.content == data
    assert item["sha256"] == hashlib.sha256(data).hexdigest() == answer.headers["etag"].strip('"')
    assert answer.headers["content-disposition"].startswith("attachment")
    etag = answer.headers["etag"]
    for given, status, content in (
        ({"Range": "bytes=2-5"}, 206, data[2:6]),
        ({"Range": "bytes=5-"}, 206, data[5:]),
        ({"Range": "bytes=-4"}, 206, data[-4:]),
        ({"Range": f"bytes={len(data)}-"}, 416, b""),
        ({"Range": "bytes=5-2"}, 200, data),
        ({"Range": "lines=1-2"}, 200, data),
        ({"Range": "bytes=2-5", "If-Range": etag}, 206, data[2:6]),
        ({"Range": "bytes=2-5", "If-Range": '"old"'}, 200, data),
        ({"If-None-Match": etag}, 304, b""),
    ):
        part = client.get(url, headers=given)
        assert (part.status_code, part.content) == (status, content), given
    run.folder.append_metrics({"iteration": 2})
    assert client.get(url, headers={"If-None-Match": etag}).status_code == 200


def test_a_file_that_grows_is_sent_as_long_as_was_said(tmp_path) -> None:
    app, file = FastAPI(), tmp_path / "a.log"
    file.write_bytes(b"abc")

    @app.get("/")
    def get(request: Request):
        answer = file_response(request, file.open("rb"), "a.log", 3, '"x"')
        file.write_bytes(b"abcdef")
        return answer

    assert TestClient(app).get("/").content == b"abc"


@pytest.mark.parametrize(
    "attack",
    [
        "..%2f..%2fetc%2fpasswd", "RUN.config.%2e%2e%2fstate", "RUN.log.../../config", "RUN.config.config%00",
        "RUN.weights.%2f", "RUN..config", "RUN.config.CONFIG", "x" * 5000, "%ff", "RUN",
    ],
)  # fmt: skip
def test_no_path_is_made_from_an_id(client, run, attack) -> None:
    answer = client.get(f"/api/v1/artefacts/{attack.replace('RUN', run.id)}")
    assert answer.status_code == 404


def test_links_in_a_run_folder_are_not_followed(client, run, tmp_path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("secret")
    (run.folder.logs / "evil.log").symlink_to(secret)
    items = client.get(f"{run.url}/artefacts").json()["items"]
    assert "evil.log" not in [item["name"] for item in items]
    assert client.get(f"/api/v1/artefacts/{run.id}.log.evil").status_code == 404


def test_episodes_are_listed_and_played(client, run) -> None:
    listed = client.get(f"{run.url}/episodes").json()
    assert (listed["iteration"], listed["first_iteration"], listed["last_iteration"]) == (1, 0, 1)
    assert [(e["episode"], e["steps"], e["episode_return"]) for e in listed["items"]] == [
        (0, 3, -1.0), (1, 3, -2.0),
    ]  # fmt: skip
    spec = RunConfig.for_task("reaching", hidden_units=8).network
    weights = replace(WeightBlob.random(spec, np.random.default_rng(0)), scale=np.float32(0.5))
    run.folder.weights_path(0).write_bytes(weights.encode())
    stored = Episode.decode(run.folder.episode_path(0, 1).read_bytes(), TASKS["reaching"])
    shown = client.get(f"{run.url}/episodes/0/1").json()
    assert shown["actions"] == [1, 2, 13]
    assert shown["outputs"] == stored.outputs.tolist()
    assert shown["preferences"] == (stored.outputs * 0.5).tolist()
    assert shown["rewards"] == [-4, -5, -6]
    assert shown["camera_to_action_us"] == [300.0, None, 400.0]
    assert (len(shown["action_names"]), shown["action_dims"]) == (14, [14])
    frames = client.get(f"{run.url}/episodes/0/1/frames")
    assert frames.headers["x-frames-shape"] == "4,1,84,84"
    assert frames.content == stored.frames.tobytes()
    assert client.get(f"{run.url}/episodes/0/7").status_code == 404
    run.folder.episode_path(0, 1).write_bytes(b"damaged")
    assert client.get(f"{run.url}/episodes/0/1/frames").status_code == 422


def test_an_action_of_several_dimensions_is_one_number(client, store) -> None:
    config = RunConfig.for_task("arm", hidden_units=8)
    folder = store.folder(store.create(config, actor="test").id)
    weights = WeightBlob.random(config.network, np.random.default_rng(0))
    folder.weights_path(0).write_bytes(weights.encode())
    choices = np.array([[0, 0, 0, 1], [3, 3, 3, 3], [6, 6, 6, 6]], np.uint8)
    stored = Episode(
        meta=EpisodeMeta(
            iteration=0, episode=0, seed=1, slot=0, worker="edge-1", weights_attempt=0, weights_version=0,
            terminated=False, deadline_misses=0, duration_ns=1,
        ),
        frames=np.zeros((4, 1, 84, 84), np.uint8),
        actions=choices,
        rewards=np.zeros(3),
        outputs=np.zeros((3, 28), np.int32),
        inference_ns=np.ones(3, np.uint32),
        camera_to_action_ns=np.ones(3, np.uint32),
    )  # fmt: skip
    folder.episode_path(0, 0).write_bytes(stored.encode())
    shown = client.get(f"/api/v1/runs/{folder.run}/episodes/0/0").json()
    assert (shown["actions"], shown["action_dims"]) == ([1, 1200, 2400], [7, 7, 7, 7])
    assert (len(shown["action_names"]), len(shown["outputs"][0])) == (28, 28)


def test_action_names_say_what_the_robots_do() -> None:
    assert TASKS["reaching"].action_names == tuple(
        f"joint {2 if two else 1} by {two or one}°" if one or two else f"joint {joint} by 0°"
        for (one, two), joint in zip(reaching.ACTIONS_DEG, [1] * 7 + [2] * 7, strict=True)
    )
    assert TASKS["tracking"].action_names == tuple(
        f"window by {px} px" for px in tracking.ACTIONS_PX
    )
    for name, (pan, tilt) in zip(TASKS["pan_tilt"].action_names, pan_tilt.ACTIONS_DEG, strict=True):
        parts = [f"pan by {pan}°"] * bool(pan) + [f"tilt by {tilt}°"] * (bool(tilt) or not pan)
        assert name == ", ".join(parts)


def test_logs_are_paged_newest_first(client, run) -> None:
    def write(service: str, seconds: range, level: str = "INFO") -> None:
        with (run.folder.logs / f"{service}.log").open("a") as log:
            for s in seconds:
                log.write(f"2026-11-22T08:00:{s:02d}.000Z {service} {level} said {s}\n")

    write("learner", range(0, 60, 2))
    write("edge-0", range(1, 60, 2))
    with (run.folder.logs / "edge-0.log").open("a") as log:
        log.write("2026-11-22T08:01:00.000Z edge-0 ERROR broke\nTraceback:\n  line\ncut")
    url = f"{run.url}/logs"
    newest = client.get(url, params={"limit": 1}).json()["items"][0]
    assert newest["message"] == "broke\nTraceback:\n  line\ncut"
    assert (newest["level"], newest["service"]) == ("ERROR", "edge-0")
    said, cursor = [], None
    while True:
        params = {"limit": 7, "level": "INFO"} | ({"cursor": cursor} if cursor else {})
        page = client.get(url, params=params).json()
        said += [item["message"] for item in page["items"]]
        write("learner", range(59, 60))  # newer lines do not come into older pages
        if (cursor := page["next_cursor"]) is None:
            break
    assert said[1:] == [f"said {s}" for s in range(59, -1, -1)]
    assert [
        i["message"][:5] for i in client.get(url, params={"level": "ERROR"}).json()["items"]
    ] == ["broke"]
    found = client.get(url, params={"search": "SAID 4", "service": "learner"}).json()["items"]
    assert {item["message"] for item in found} == {
        "said 4",
        *(f"said {s}" for s in range(40, 50, 2)),
    }
