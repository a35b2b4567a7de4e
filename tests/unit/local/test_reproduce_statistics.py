"""Statistics over seeds: properties that any correct version has, and hand-made examples."""

from random import Random

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn.reproduce import statistics

VALUES = st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=12).map(np.array)


@given(VALUES, st.randoms())
def test_the_interquartile_mean_is_a_mean_of_the_middle(
    values: npt.NDArray[np.float64], random: Random
) -> None:
    found = statistics.iqm(values)
    shuffled = values.copy()
    random.shuffle(shuffled)
    assert statistics.iqm(shuffled) == pytest.approx(found)
    assert statistics.iqm(values + 7.0) == pytest.approx(found + 7.0)
    assert np.percentile(values, 0) - 1e-9 <= found <= np.percentile(values, 100) + 1e-9
    if len(values) < 4:
        assert found == pytest.approx(values.mean())


@given(
    st.lists(st.floats(-100, 100), min_size=4, max_size=12).map(np.array), st.floats(200.0, 1e300)
)
def test_one_seed_however_bad_does_not_move_the_interquartile_mean(
    values: npt.NDArray[np.float64], outlier: float
) -> None:
    worst, worse = values.copy(), values.copy()
    worst[values.argmin()], worse[values.argmin()] = -outlier, -1e4
    assert statistics.iqm(worst) == statistics.iqm(worse)


def test_of_five_seeds_the_middle_three_count() -> None:
    assert statistics.iqm(np.array([5.0, 1.0, 3.0, 100.0, 4.0])) == 4.0
    with pytest.raises(ValueError, match="no values"):
        statistics.iqm(np.array([]))


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
    runs = [{"returns_px": [1, 2, 3]}, {"returns_px": [4, 5]}]
    assert statistics.curves(runs, "returns_px").tolist() == [[1, 2], [4, 5]]
    with pytest.raises(ValueError, match="no runs"):
        statistics.curves([], "returns_px")


def test_a_shortfall_is_in_percent_of_the_better_return_whose_sign_does_not_matter() -> None:
    assert statistics.shortfall_percent(-115.0, -100.0) == pytest.approx(15.0)
    assert statistics.shortfall_percent(-90.0, -100.0) == pytest.approx(-10.0)
    assert statistics.shortfall_percent(80.0, 100.0) == pytest.approx(20.0)


def test_group_keeps_the_order_of_appearance() -> None:
    runs = [{"a": 2, "b": 0}, {"a": 1, "b": 1}, {"a": 2, "b": 2}]
    groups = statistics.group(runs, "a")
    assert list(groups) == [(2,), (1,)]
    assert [run["b"] for run in groups[2,]] == [0, 2]
