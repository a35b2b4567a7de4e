"""A disk that is full, at whichever write: the request says so, and nothing half made stays."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

RUN = {"config": {"task": "reaching"}, "name": "one"}
SWEEP = {"name": "s", "config": {"task": "reaching"}, "grid": {"alpha": [0.5, 0.9]}}


@contextmanager
def full_from(write: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """From the given write on, no file is brought to disk; counts the writes."""
    real, writes = os.fsync, []

    def fsync(descriptor: int) -> None:
        writes.append(descriptor)
        if len(writes) > write:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", fsync)
        yield writes


def everything(runs_dir: Path) -> set[Path]:
    return set(runs_dir.rglob("*")) - {runs_dir / "sweeps"}


@pytest.mark.parametrize(("path", "body"), [("runs", RUN), ("sweeps", SWEEP)])
def test_what_cannot_be_made_leaves_nothing(client, store, monkeypatch, path, body) -> None:
    before = everything(store.runs_dir)
    tried = 0
    for write in range(100):
        with full_from(write, monkeypatch):
            answer = client.post(f"/api/v1/{path}", json=body)
        if answer.status_code == 201:
            break
        tried += 1
        assert answer.status_code == 507, answer.text
        assert answer.json()["type"] == "urn:bpn:problem:disk-full"
        assert everything(store.runs_dir) == before
        assert client.get("/api/v1/runs").json()["total"] == 0
        assert client.get("/api/v1/sweeps").json()["items"] == []
    assert tried > 5
    assert client.get("/api/v1/runs").json()["total"] == (1 if path == "runs" else 2)


def test_a_change_that_cannot_be_written_did_not_happen(client, store, monkeypatch) -> None:
    run = client.post("/api/v1/runs", json=RUN).json()
    url, before = f"/api/v1/runs/{run['id']}", everything(store.runs_dir)
    with full_from(0, monkeypatch):
        answer = client.patch(url, json={"notes": "x"}, headers={"If-Match": "*"})
        stopped = client.post(f"{url}/stop")
        bulk = client.post("/api/v1/runs/bulk", json={"action": "archive", "ids": [run["id"]]})
    assert (answer.status_code, stopped.status_code) == (507, 507)
    assert bulk.json()["results"][0]["problem"]["status"] in (409, 507)
    assert client.get(url).json() == run
    assert everything(store.runs_dir) == before
    again = client.patch(url, json={"notes": "x"}, headers={"If-Match": "*"})
    assert again.json()["notes"] == "x"
