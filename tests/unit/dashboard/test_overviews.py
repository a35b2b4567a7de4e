"""What many runs have in common, through HTTP: figures are of all runs, and bulk changes touch what they say."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.registry.failures import gather, reason_of
from bpn_shared.spec.config import RunConfig


def make(store, number, **about):
    config = RunConfig.for_task("reaching", seed=number, alpha=0.5 if number % 2 else 0.9)
    return store.create(config, actor="test", name=f"run {number}", **about).id


def test_an_overview_is_of_all_runs(client, store) -> None:
    ids = [make(store, number) for number in range(5)]
    other = store.create(RunConfig.for_task("tracking", gamma=0.5), actor="test").id
    store.request_stop(ids[0], "test")
    found = client.get("/api/v1/runs/overview").json()
    assert (found["total"], found["states"]) == (6, {"queued": 5, "stopped": 1})
    assert found["tasks"] == {"reaching": 5, "tracking": 1}
    differing = {one["key"]: one for one in found["differing"]}
    assert differing["gamma"]["distinct"] == 2
    assert differing["alpha"]["values"][0]["runs"] >= 2
    assert "pacing" in found["same"]
    assert client.get("/api/v1/runs/overview?task=tracking").json()["total"] == 1
    assert client.get("/api/v1/runs/ids?task=reaching").json()["ids"] == ids[::-1]
    assert client.get("/api/v1/runs/ids?query=gamma=0.5").json()["ids"] == [other]
    assert client.get("/api/v1/runs/ids?query=gamma=").status_code == 422


def test_columns_of_metrics_come_with_the_list_and_order_it(client, store, context) -> None:
    ids = [make(store, number) for number in range(3)]
    for number, run_id in enumerate(ids[:2]):
        folder = store.folder(run_id)
        for iteration in range(7):
            folder.append_metrics({"iteration": iteration, "loss": float(iteration + 10 * number)})
        context.ingest.take_in([store.get(run_id)])
    columns = "metric.loss.last,metric.loss.mean_5,metric.loss.highest"
    page = client.get(f"/api/v1/runs?sort=-metric.loss.lowest&columns={columns}").json()["items"]
    assert [run["id"] for run in page] == [ids[1], ids[0], ids[2]]
    assert list(page[0]["values"].values()) == [16.0, 14.0, 16.0]
    assert set(page[2]["values"].values()) == {None}
    assert [run["seed"] for run in client.get("/api/v1/runs?sort=config.seed").json()["items"]] == [
        0,
        1,
        2,
    ]
    for wrong in ("metric.loss", "metric.loss.middle", "config.colour", "colour"):
        assert client.get(f"/api/v1/runs?sort={wrong}").status_code == 422
        if wrong.startswith("metric"):
            assert client.get(f"/api/v1/runs?columns={wrong}").status_code == 422


def test_values_of_runs_for_charts_of_runs_over_each_other(client, store, context) -> None:
    ids = [make(store, number) for number in range(3)]
    store.folder(ids[1]).append_metrics({"iteration": 0, "loss": 2.0})
    context.ingest.take_in([store.get(ids[1])])
    columns = ["config.alpha", "metric.loss.last", "seed"]
    found = client.post("/api/v1/runs/values", json={"filter": {}, "columns": columns}).json()
    assert (found["total"], found["ids"]) == (3, ids[::-1])
    assert found["columns"] == {
        "config.alpha": [0.9, 0.5, 0.9], "metric.loss.last": [None, 2.0, None], "seed": [2, 1, 0]
    }  # fmt: skip
    chosen = {"runs": ids[:1], "columns": columns}
    assert client.post("/api/v1/runs/values", json=chosen).json()["names"] == ["run 0"]
    unknown = chosen | {"runs": [*chosen["runs"], "01a201f9-821b-74c6-95eb-3f4ab1331c4c"]}
    assert client.post("/api/v1/runs/values", json=unknown).status_code == 404
    for wrong in ({"columns": columns}, {"filter": {}, "columns": ["colour"]}):
        assert client.post("/api/v1/runs/values", json=wrong).status_code == 422


def test_failures_are_gathered_by_reason_and_found_by_their_query(client, store) -> None:
    errors = ["no GPU at worker 1", "no GPU at worker 27", 'said "stop" at 3', ""]
    for number, error in enumerate(errors):
        store.observe({make(store, number): {"state": "failed", "error": error}})
    make(store, 9)
    items = client.get("/api/v1/runs/failures").json()["items"]
    assert [(one["reason"], one["runs"]) for one in items] == [
        ("no GPU at worker 1", 2), ("", 1), ('said "stop" at 3', 1)
    ]  # fmt: skip
    for item in items[::2]:
        found = client.get("/api/v1/runs", params={"query": item["query"]}).json()
        assert found["total"] == item["runs"]


@given(st.lists(st.tuples(st.text(max_size=60), st.integers(1, 5)), max_size=8))
def test_every_failure_has_a_reason(errors) -> None:
    reasons = gather(errors)
    assert sum(one.runs for one in reasons) == sum(runs for _, runs in errors)
    for one in reasons:
        assert one.part in one.example


def test_a_tracebacks_reason_is_its_last_line() -> None:
    traceback = 'Traceback (most recent call last):\n  File "x", line 3\nValueError: bad\n'
    assert reason_of(traceback) == "ValueError: bad"
    assert reason_of("first\nsecond") == "first"


def test_tags_are_changed_of_many_at_once(client, store) -> None:
    ids = [make(store, number, tags=["old", "größe"]) for number in range(3)]
    body = {"ids": ids[:2], "add": ["new", "old", "new"], "remove": ["größe"]}
    assert client.post("/api/v1/runs/tags", json=body).json() == {"changed": 2}
    assert client.post("/api/v1/runs/tags", json=body).json() == {"changed": 0}
    assert store.get(ids[0]).tags == ["old", "new"]
    assert client.get("/api/v1/tags").json()["items"] == [
        {"name": "größe", "runs": 1}, {"name": "new", "runs": 2}, {"name": "old", "runs": 3}
    ]  # fmt: skip
    assert client.post("/api/v1/runs/tags", json={"ids": [ids[0][::-1]]}).status_code == 404


@pytest.mark.parametrize("role", ["viewer", None])
def test_who_may_only_look_changes_nothing(client_of, role) -> None:
    client = client_of(role)
    body = {"name": "mine", "query": "page=runs"}
    assert client.post("/api/v1/views", json=body).status_code == (403 if role else 401)
    assert client.post(
        "/api/v1/queue/move", json={"ids": ["x" * 36], "to": "front"}
    ).status_code in (401, 403)


def test_views_are_saved_beside_the_runs_and_outlive_the_database(client, store) -> None:
    made = client.post(
        "/api/v1/views", json={"name": " Paper ", "query": "page=runs&query=tag%3Ap"}
    ).json()
    other = client.post("/api/v1/views", json={"name": "all", "query": "page=compare"}).json()
    assert [view["name"] for view in client.get("/api/v1/views").json()["items"]] == [
        "all",
        "Paper",
    ]
    changed = {"name": "Paper 2", "query": "page=runs"}
    assert client.put(f"/api/v1/views/{made['id']}", json=changed).json()["name"] == "Paper 2"
    file = store.runs_dir / "views" / f"{made['id']}.json"
    file.write_text(file.read_text().replace("Paper 2", "Paper 3"))  # damaged
    assert [view["name"] for view in client.get("/api/v1/views").json()["items"]] == ["all"]
    assert client.delete(f"/api/v1/views/{other['id']}").status_code == 204
    for gone in (other["id"], "..nothing", "nothing"):
        assert client.delete(f"/api/v1/views/{gone}").status_code == 404
    for wrong in ("", "https://elsewhere.example", "page=runs#x", "page=a b"):
        assert client.post("/api/v1/views", json={"name": "x", "query": wrong}).status_code == 422
    assert (
        client.post("/api/v1/views", json={"name": " \u202e", "query": "page=runs"}).status_code
        == 422
    )


def test_waiting_runs_are_moved_before_and_behind_the_others(client, store) -> None:
    ids = [make(store, number) for number in range(4)]

    def order():
        return [ids.index(run["id"]) for run in client.get("/api/v1/queue").json()["items"]]

    assert order() == [0, 1, 2, 3]
    client.post("/api/v1/queue/move", json={"ids": ids[2:], "to": "front"})
    assert order() == [2, 3, 0, 1]
    client.post("/api/v1/queue/move", json={"ids": [ids[2]], "to": "back"})
    assert order() == [3, 0, 1, 2]
    store.request_stop(ids[0], "test")
    moved = client.post("/api/v1/queue/move", json={"ids": [ids[0]], "to": "front"})
    assert (moved.status_code, moved.json()["type"]) == (409, "urn:bpn:problem:run-state")
    store.index.rebuild()  # the order stands in the folders too
    assert order() == [3, 1, 2]


def test_what_a_run_would_wait_for_is_told_before_it_is_made(client, store) -> None:
    config = {"task": "reaching"}
    notices = client.post("/api/v1/runs/check", json=config).json()["notices"]
    assert "It needs 1 learner, and none is connected: it waits until there are enough." in notices
    make(store, 0)
    assert (
        client.post("/api/v1/runs/check", json=config).json()["notices"][-1]
        == "1 run waits before it."
    )
    wrong = client.post("/api/v1/runs/check", json=config | {"init_from": "nobody"})
    assert wrong.status_code == 422
    assert client.get("/api/v1/runs").json()["total"] == 1
