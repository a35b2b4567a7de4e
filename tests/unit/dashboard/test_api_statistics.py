"""Figures over seeds through HTTP: a seed counts once, however many runs were made with it."""

import numpy as np
import pytest

from bpn_shared.spec.config import RunConfig

RETURNS = {0: -362.0, 1: -391.0, 2: -430.0}
"""Of each seed; a run's is the same whenever it is made."""


@pytest.fixture
def repeated(store, context):
    """Eleven runs of seed 0 beside a sweep of three seeds."""
    for seed in [0] * 11 + [0, 1, 2]:
        row = store.create(RunConfig.for_task("reaching", seed=seed), actor="test")
        store.folder(row.id).append_metrics({"iteration": 0, "return_px": RETURNS[seed]})
    context.ingest.poll()


@pytest.mark.parametrize("group_by", ["all_but_seed", ["task"], []])
@pytest.mark.usefixtures("repeated")
def test_fourteen_runs_of_three_seeds_are_three_samples(client, group_by) -> None:
    body = {"filter": {}, "metrics": ["return_px"], "group_by": group_by, "band": "sem"}
    (curve,) = client.post("/api/v1/series/query", json=body).json()["series"]
    three = np.array(list(RETURNS.values()))
    assert (len(curve["run_ids"]), curve["seeds"], curve["n"]) == (14, 3, [3.0])
    assert curve["value"] == pytest.approx([three.mean()])
    sem = three.std(ddof=1) / 3**0.5
    assert curve["high"][0] - curve["value"][0] == pytest.approx(sem)


@pytest.mark.usefixtures("repeated")
def test_every_run_for_itself_is_one_seed(client) -> None:
    body = {"filter": {}, "metrics": ["return_px"], "group_by": None}
    curves = client.post("/api/v1/series/query", json=body).json()["series"]
    assert [curve["seeds"] for curve in curves] == [1] * 14
    assert all(curve["low"] == [None] for curve in curves)


@pytest.mark.usefixtures("repeated")
def test_of_too_many_lines_the_newest_are_drawn_and_all_are_counted(client, store) -> None:
    body = {"filter": {}, "metrics": ["return_px"], "group_by": None}
    newest = [row.id for row in store.find()][-5:]
    answer = client.post("/api/v1/series/query", json=body | {"max_groups": 5}).json()
    assert [curve["run_ids"] for curve in answer["series"]] == [[run] for run in newest]
    assert answer["groups"] == 14
    assert client.post("/api/v1/series/query", json=body | {"max_groups": 0}).status_code == 422
    for _ in range(100):
        store.create(RunConfig.for_task("reaching"), actor="test")
    answer = client.post("/api/v1/series/query", json=body).json()
    assert (len(answer["series"]), answer["groups"]) == (100, 114)


@pytest.mark.usefixtures("repeated")
def test_a_cell_of_the_heat_map_counts_seeds(client) -> None:
    (cell,) = client.get("/api/v1/heatmap?x=alpha&y=task").json()["cells"]
    three = np.array(list(RETURNS.values()))
    assert (cell["n"], len(cell["run_ids"])) == (3, 14)
    assert (cell["mean"], cell["std"]) == pytest.approx((three.mean(), three.std(ddof=1)))


def test_one_seed_made_often_has_no_spread(client, store, context) -> None:
    for _ in range(5):
        row = store.create(RunConfig.for_task("reaching"), actor="test")
        store.folder(row.id).append_metrics({"iteration": 0, "return_px": -1.0})
    context.ingest.poll()
    (cell,) = client.get("/api/v1/heatmap?x=alpha&y=task").json()["cells"]
    assert (cell["n"], cell["std"]) == (1, None)
