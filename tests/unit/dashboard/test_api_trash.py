"""Removing, restoring and deleting runs through HTTP: who may, what it says, and when the disk is full."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from disks import no_file_grows
from fastapi.testclient import TestClient


def stopped(client: TestClient, name: str = "one") -> str:
    run = client.post("/api/v1/runs", json={"config": {"task": "reaching"}, "name": name}).json()
    client.post(f"/api/v1/runs/{run['id']}/stop")
    return str(run["id"])


def problem(answer: Any) -> tuple[int, str]:
    return answer.status_code, answer.json()["type"].removeprefix("urn:bpn:problem:")


def test_removed_seen_in_the_trash_and_restored(client, client_of, store) -> None:
    run = stopped(client)
    before = client.get(f"/api/v1/runs/{run}").json()
    files = [path for path in store.folder(run).path.rglob("*") if path.is_file()]
    size_bytes = sum(path.stat().st_size for path in files)
    operator, viewer = client_of("operator"), client_of("viewer")
    removed = operator.delete(f"/api/v1/runs/{run}").json()
    assert (removed["id"], removed["name"], removed["removed_by"]) == (run, "one", "operator")
    assert removed["kept_until_unix_s"] == removed["removed_at_unix_s"] + 7 * 86_400
    assert removed["size_bytes"] == size_bytes > 1000
    assert viewer.get("/api/v1/trash").json() == {"items": [removed]}
    assert problem(client.get(f"/api/v1/runs/{run}")) == (404, "unknown-run")
    again = client.delete(f"/api/v1/runs/{run}")
    assert problem(again) == (404, "unknown-run")
    assert "is in the trash, removed by operator" in again.json()["detail"]

    restored = operator.post(f"/api/v1/trash/{run}/restore").json()
    assert restored | {"updated_at_unix_s": 0} == before | {"updated_at_unix_s": 0}
    late = operator.post(f"/api/v1/trash/{run}/restore")
    assert problem(late) == (404, "unknown-run")
    assert "is not in the trash: it is where it was" in late.json()["detail"]
    done = client.get("/api/v1/audit", params={"subject": run}).json()["items"]
    assert [(one["actor"], one["action"]) for one in done[:2]] == [
        ("operator", "restore"),
        ("operator", "remove"),
    ]


def test_who_may_what(client, client_of) -> None:
    run = stopped(client)
    viewer, operator = client_of("viewer"), client_of("operator")
    assert viewer.delete(f"/api/v1/runs/{run}").status_code == 403
    assert viewer.post("/api/v1/runs/prune", json={"keep": 0}).status_code == 403
    operator.delete(f"/api/v1/runs/{run}")
    assert viewer.post(f"/api/v1/trash/{run}/restore").status_code == 403
    for path in (f"/api/v1/trash/{run}", "/api/v1/trash"):
        assert operator.delete(path).status_code == 403
    assert client.delete(f"/api/v1/trash/{run}").status_code == 204
    assert problem(client.delete(f"/api/v1/trash/{run}")) == (404, "unknown-run")


def test_what_is_queued_or_learned_stays(client, store) -> None:
    queued = client.post("/api/v1/runs", json={"config": {"task": "reaching"}}).json()["id"]
    refused = client.delete(f"/api/v1/runs/{queued}")
    assert problem(refused) == (409, "run-busy")
    assert (
        f"is queued: stop it before removing it (`bpn runs stop {queued}`)"
        in refused.json()["detail"]
    )
    run = stopped(client)
    with store.folder(run).owned("bpn train"):
        refused = client.delete(f"/api/v1/runs/{run}")
    assert problem(refused) == (409, "run-busy")
    assert client.get("/api/v1/runs").json()["total"] == 2


def test_many_at_once(client) -> None:
    runs = [stopped(client) for _ in range(3)]
    for action in ("remove", "restore"):
        answer = client.post("/api/v1/runs/bulk", json={"action": action, "ids": [*runs, runs[0]]})
        assert [one["ok"] for one in answer.json()["results"]] == [True, True, True, False]
    assert client.get("/api/v1/runs").json()["total"] == 3


def test_pruned_and_emptied(client) -> None:
    runs = [stopped(client, str(n)) for n in range(3)]
    assert problem(client.post("/api/v1/runs/prune", json={})) == (422, "configuration")
    told = client.post("/api/v1/runs/prune", json={"keep": 1, "dry_run": True}).json()["items"]
    assert [(one["id"], one["ok"]) for one in told] == [(run, True) for run in runs[:2]]
    assert client.get("/api/v1/runs").json()["total"] == 3
    assert client.post("/api/v1/runs/prune", json={"older_than_days": 1.0}).json()["items"] == []
    assert client.post("/api/v1/runs/prune", json={"keep": 1}).json()["items"] == told
    emptied = client.delete("/api/v1/trash").json()["items"]
    assert sorted(one["id"] for one in emptied) == sorted(runs[:2])
    assert client.get("/api/v1/trash").json() == {"items": []}
    assert client.get("/api/v1/runs").json()["total"] == 1


def test_a_full_disk_is_no_obstacle(client, store) -> None:
    run, other = stopped(client), stopped(client)
    client.delete(f"/api/v1/runs/{other}")
    with no_file_grows():
        assert client.delete(f"/api/v1/runs/{run}").status_code == 200
        assert client.get("/api/v1/runs").json()["total"] == 0
        assert client.get(f"/api/v1/runs/{run}").status_code == 404
        assert client.post(f"/api/v1/trash/{other}/restore").status_code == 200
        assert client.delete(f"/api/v1/trash/{run}").status_code == 204
    store.adopt()
    assert [item["id"] for item in client.get("/api/v1/runs").json()["items"]] == [other]
    assert client.get("/api/v1/trash").json() == {"items": []}


def test_a_folder_that_cannot_be_moved_stays(client, store) -> None:
    run = stopped(client)
    (store.runs_dir / ".trash").symlink_to("/tmp")
    assert problem(client.delete(f"/api/v1/runs/{run}")) == (409, "foreign-file")
    assert client.get(f"/api/v1/runs/{run}").json()["state"] == "stopped"


@pytest.mark.parametrize("act", ["remove", "restore"])
def test_of_several_requests_one_does_it(client, act: str) -> None:
    run, begin = stopped(client), threading.Barrier(4)
    if act == "restore":
        client.delete(f"/api/v1/runs/{run}")

    def call(_: int) -> int:
        begin.wait()
        if act == "remove":
            return int(client.delete(f"/api/v1/runs/{run}").status_code)
        return int(client.post(f"/api/v1/trash/{run}/restore").status_code)

    with ThreadPoolExecutor(4) as pool:
        assert sorted(pool.map(call, range(4))) == [200, 404, 404, 404]
    assert client.get("/api/v1/runs").json()["total"] == (1 if act == "restore" else 0)
