"""Mean and spread over seeds: the standard library and SciPy are oracles; the web UI's tests share the vectors."""

import json
import statistics as standard
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bpn_shared.runs.statistics import iqm, mean_std, merge_seeds, over_seeds

VECTORS = json.loads((Path(__file__).parents[3] / "vectors" / "statistics.json").read_text())
values = st.floats(-1e6, 1e6)
samples = st.lists(st.tuples(st.integers(0, 5), values), min_size=1, max_size=30)


@pytest.mark.parametrize("case", VECTORS, ids=lambda case: case["name"])
def test_the_vectors_that_every_language_computes(case: dict[str, Any]) -> None:
    found = over_seeds(*zip(*((one["seed"], one["value"]) for one in case["samples"]), strict=True))
    expected = case["expected"]
    assert (found.runs, found.seeds) == (expected["runs"], expected["seeds"])
    assert found.mean == pytest.approx(expected["mean"], rel=1e-12)
    assert found.std == (None if expected["std"] is None else pytest.approx(expected["std"]))


@given(samples)
def test_it_is_the_standard_librarys_over_the_seeds_means(
    runs: list[tuple[int, float]],
) -> None:
    of_seeds: dict[int, list[float]] = {}
    for seed, value in runs:
        of_seeds.setdefault(seed, []).append(value)
    means = [standard.fmean(of_one) for of_one in of_seeds.values()]
    found = over_seeds(*zip(*runs, strict=True))
    assert (found.runs, found.seeds) == (len(runs), len(means))
    assert found.mean == pytest.approx(standard.fmean(means), rel=1e-9, abs=1e-6)
    if len(means) == 1:
        assert found.std is None
    else:
        assert found.std == pytest.approx(standard.stdev(means), rel=1e-6, abs=1e-6)


@given(
    st.lists(values, min_size=1, max_size=6), st.lists(st.integers(1, 12), min_size=6, max_size=6)
)
def test_repeating_runs_of_a_seed_changes_neither_mean_nor_spread(
    of_seeds: list[float], repeated: list[int]
) -> None:
    once = over_seeds(range(len(of_seeds)), of_seeds)
    runs = [(seed, v) for seed, v in enumerate(of_seeds) for _ in range(repeated[seed])]
    often = over_seeds(*zip(*runs, strict=True))
    assert often.seeds == once.seeds
    assert often.mean == pytest.approx(once.mean, rel=1e-12, abs=1e-9)
    if once.std is not None:
        assert often.std == pytest.approx(once.std, rel=1e-6, abs=1e-6)


def test_a_missing_value_does_not_count_and_the_order_of_rows_does_not_matter() -> None:
    nan = float("nan")
    rows = np.array([[1.0, nan, nan], [3.0, nan, 5.0], [0.1, 0.2, 0.3], [0.7, 8.0, nan]])
    merged = merge_seeds([4, 4, 1, 4], rows)
    np.testing.assert_allclose(merged, [[4.7 / 3, 8.0, 5.0], [0.1, 0.2, 0.3]])
    other = merge_seeds([4, 4, 1, 4], rows[[3, 0, 2, 1]])
    assert merged.tobytes() == other.tobytes()
    assert np.isnan(merge_seeds([0, 0], np.array([[nan], [nan]]))).all()


@given(st.lists(values, min_size=1, max_size=12), st.randoms())
def test_the_interquartile_mean_is_scipys_trimmed_mean(found: list[float], random: Random) -> None:
    expected = stats.trim_mean(np.array(found), 0.25)
    assert iqm(found) == pytest.approx(expected, rel=1e-9, abs=1e-6)
    random.shuffle(found)
    assert iqm(found) == pytest.approx(expected, rel=1e-9, abs=1e-6)


def test_of_nothing_there_is_no_figure() -> None:
    for of_nothing in (mean_std, iqm):
        with pytest.raises(ValueError, match="no values"):
            of_nothing([])
    with pytest.raises(ValueError, match="no values"):
        over_seeds([], [])
    with pytest.raises(ValueError, match="2 rows of 1 seeds"):
        over_seeds([1], [1.0, 2.0])
