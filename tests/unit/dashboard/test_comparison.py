"""Groups compared through HTTP: seeds are the sample, and the sentence says no more than they show."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bpn_dashboard.comparison.scores import ScoredRun, Scores
from bpn_dashboard.comparison.summary import compare
from bpn_dashboard.comparison.verdicts import enough_seeds
from bpn_shared.spec.config import RunConfig

runs = st.lists(
    st.tuples(
        st.integers(0, 4),
        st.sampled_from(["reaching", "tracking"]),
        st.one_of(st.none(), st.floats(-1e6, 1e6)),
    ),
    max_size=15,
)


def scores_of(values) -> Scores:
    return Scores.of([ScoredRun(str(place), *value) for place, value in enumerate(values)])


@given(runs)
def test_a_seed_is_one_sample_and_one_without_a_value_is_told(values) -> None:
    found = scores_of(values)
    by_seed = {}
    for seed, task, score in values:
        by_seed.setdefault((task, seed), []).append(score)
    known = {key: [v for v in of_one if v is not None] for key, of_one in by_seed.items()}
    assert found.missing == sum(not of_one for of_one in known.values())
    assert {(one.stratum, one.seed): one.score for one in found.seeds} == {
        key: pytest.approx(np.mean(of_one), rel=1e-9, abs=1e-6)
        for key, of_one in known.items()
        if of_one
    }


@given(runs, runs, st.booleans())
def test_anything_can_be_compared(ones, others, higher_is_better) -> None:
    groups = [scores_of(ones), scores_of(others)]
    found = compare(groups, [scores_of([])] * 2, 0, higher_is_better=higher_is_better)
    assert found.groups[0].against is None
    against = found.groups[1].against
    common = groups[0].strata().keys() & groups[1].strata().keys()
    assert (against is not None) == bool(common)
    if against is not None:
        assert 0 <= against.improvement.value <= 1
        assert 0 < against.p <= 1
    for group, summary in zip(groups, found.groups, strict=True):
        pooled = [one.score for one in group.seeds]
        if pooled:
            assert summary.iqm.value == pytest.approx(
                stats.trim_mean(pooled, 0.25), rel=1e-9, abs=1e-6
            )
            assert summary.profile.share[-1] == 0  # nothing is above the largest of all
        else:
            assert math.isnan(summary.iqm.value)


@pytest.fixture
def start(store, context):
    """Makes runs with returns, by (alpha, seed)."""

    def make(returns, **more):
        ids = []
        for (alpha, seed), value in returns:
            row = store.create(RunConfig.for_task("reaching", seed=seed, alpha=alpha), actor="test")
            record = {"iteration": 0, "return_px": value, "episodes": 4, **more}
            store.folder(row.id).append_metrics(record)
            context.ingest.take_in([row])
            ids.append(row.id)
        return ids

    return make


def asked(client, **body):
    answer = client.post("/api/v1/comparison", json={"filter": {}, **body})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_three_seeds_each_are_too_few_and_the_sentence_says_how_many_are_not(client, start) -> None:
    start([((0.5, seed), -400.0 - seed) for seed in (0, 1, 2)])
    start([((0.95, seed), -300.0 - seed) for seed in (0, 1, 2)], successes=3)
    answer = asked(client)
    low, high = answer["groups"]
    assert (low["seeds"], high["seeds"], answer["baseline"]) == (3, 3, low["key"])
    assert high["against"]["improvement"]["value"] == 1
    assert high["against"]["p"] == pytest.approx(0.1)
    assert high["against"]["verdict"] == "too few seeds"
    assert answer["conclusion"] == (
        "alpha=0.95 is ahead of alpha=0.5 in the mean of the last 5 returns so far (it wins 100 % of the pairs of "
        "seeds, p = 0.1, 3 seeds each), but so few seeds cannot show a difference: run at least 4 of each."
    )
    assert high["success"]["value"] == 0.75
    assert low["success"]["value"] is None


def test_five_seeds_apart_are_better_and_worse(client, start) -> None:
    start([((0.5, seed), -400.0 - seed) for seed in range(5)])
    start([((0.95, seed), -300.0 - seed) for seed in range(5)])
    answer = asked(client)
    assert answer["groups"][1]["against"]["verdict"] == "better"
    assert answer["conclusion"].startswith("alpha=0.95 is better than alpha=0.5 in ")
    assert asked(client, higher_is_better=False)["groups"][1]["against"]["verdict"] == "worse"
    pinned = asked(client, baseline=answer["groups"][1]["key"])
    assert pinned["groups"][0]["against"]["verdict"] == "worse"
    assert pinned["groups"][0]["against"]["difference"]["value"] == pytest.approx(-100)


def test_fourteen_runs_of_three_seeds_are_three_dots(client, start) -> None:
    start([((0.5, seed), -400.0 - seed) for seed in [0] * 11 + [0, 1, 2]])
    (group,) = asked(client)["groups"]
    assert (group["runs"], group["seeds"], group["missing"]) == (14, 3, 0)
    assert [len(one["run_ids"]) for one in group["scores"]] == [12, 1, 1]
    assert group["mean"] == pytest.approx(-401)


def test_a_seed_that_diverged_is_told_and_not_counted(client, start) -> None:
    start([((0.5, 0), -400.0), ((0.5, 1), None)])
    (group,) = asked(client)["groups"]
    assert (group["seeds"], group["missing"], group["iqm"]["low"]) == (1, 1, None)
    assert asked(client)["conclusion"] == (
        "There is nothing to compare it with: one group has values."
    )


def test_no_runs_no_values_and_unknown_groups_are_said(client, start) -> None:
    assert asked(client)["conclusion"] == "No run meets this."
    ids = start([((0.5, 0), -400.0)])
    assert asked(client, metric="never")["conclusion"] == "No run has a value of this yet."
    wrong = client.post("/api/v1/comparison", json={"filter": {}, "baseline": "other"})
    assert (wrong.status_code, wrong.json()["type"]) == (422, "urn:bpn:problem:baseline")
    both = client.post("/api/v1/comparison", json={"filter": {}, "runs": ids})
    assert both.status_code == 422


def test_enough_seeds_are_those_whose_least_p_is_small_enough() -> None:
    assert [enough_seeds(tests) for tests in (1, 2, 10)] == [4, 5, 6]


def test_distributions_of_episodes_give_every_seed_the_same_weight(client, start, store) -> None:
    ids = start([((0.5, 0), -1.0), ((0.5, 1), -1.0), ((0.9, 0), -1.0)])
    for run_id, rounds in zip(
        ids, ([[0.0] * 8], [[10.0, 10.0]], [[5.0], [6.0, None]]), strict=True
    ):
        for iteration, returns in enumerate(rounds, 1):
            store.folder(run_id).append_metrics({"iteration": iteration, "returns_px": returns})
    (store.runs_dir / ids[2] / "metrics.jsonl").open("a").write("no line\n")
    found = client.post("/api/v1/comparison/episodes", json={"filter": {}}).json()
    first, second = found["groups"]
    assert (found["edges"][0], found["edges"][-1], found["runs"]) == (0, 10, 3)
    assert (first["episodes"], first["seeds"], second["episodes"]) == (10, 2, 2)
    assert (first["shares"][0], first["shares"][-1]) == (0.5, 0.5)
    assert sum(second["shares"]) == pytest.approx(1)
    newest = {"filter": {}, "iterations": 1}
    assert (
        client.post("/api/v1/comparison/episodes", json=newest).json()["groups"][1]["episodes"] == 1
    )
    none = {"filter": {"task": "tracking"}}
    assert client.post("/api/v1/comparison/episodes", json=none).json()["groups"] == []
