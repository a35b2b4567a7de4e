"""Statistics over seeds: properties that any correct version has, and hand-made examples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn.reproduce import statistics


def test_full_length_shares_count_the_episodes_that_did_not_fail() -> None:
    record = {"episodes": 10, "failures": [10, 4, 0]}
    assert statistics.full_length_shares(record) == [0.0, 0.6, 1.0]


@given(seeds=st.integers(1, 5), iterations=st.integers(1, 30), last=st.integers(1, 40))
def test_at_end_looks_at_the_last_iterations_of_each_seed(
    seeds: int, iterations: int, last: int
) -> None:
    values = np.arange(seeds * iterations, dtype=float).reshape(seeds, iterations)
    counted = min(last, iterations)
    expected = [row[-1] - (counted - 1) / 2 for row in values]
    assert statistics.at_end(values, last).tolist() == pytest.approx(expected)


def test_curves_are_cut_to_the_shortest_run() -> None:
    runs = [{"seed": 0, "returns_px": [1, 2, 3]}, {"seed": 1, "returns_px": [4, 5]}]
    assert statistics.curves(runs, "returns_px").tolist() == [[1, 2], [4, 5]]
    with pytest.raises(ValueError, match="no runs"):
        statistics.curves([], "returns_px")


def test_runs_of_one_seed_are_one_sample() -> None:
    runs = [{"seed": seed, "returns_px": [value]} for seed, value in ((3, 1.0), (5, 8.0), (3, 2.0))]
    assert statistics.curves(runs, "returns_px").tolist() == [[1.5], [8.0]]
    assert statistics.of_seeds(runs, [1.0, 8.0, 2.0]).tolist() == [1.5, 8.0]
    assert statistics.count(runs) == "2 (3 runs)"
    assert statistics.count(runs[:2]) == "2"


def test_a_shortfall_is_in_percent_of_the_better_return_whose_sign_does_not_matter() -> None:
    assert statistics.shortfall_percent(-115.0, -100.0) == pytest.approx(15.0)
    assert statistics.shortfall_percent(-90.0, -100.0) == pytest.approx(-10.0)
    assert statistics.shortfall_percent(80.0, 100.0) == pytest.approx(20.0)


def test_group_keeps_the_order_of_appearance() -> None:
    runs = [{"a": 2, "b": 0}, {"a": 1, "b": 1}, {"a": 2, "b": 2}]
    groups = statistics.group(runs, "a")
    assert list(groups) == [(2,), (1,)]
    assert [run["b"] for run in groups[2,]] == [0, 2]
