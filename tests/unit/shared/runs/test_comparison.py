"""Oracle: SciPy, which knows none of this; its own resamples are drawn anew, so intervals agree within a share."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bpn_shared.runs import comparison
from bpn_shared.runs.comparison import (
    holm,
    iqm_difference,
    iqm_with_interval,
    least_p,
    mean_with_interval,
    performance_profile,
    probability_of_improvement,
    rank_sum_p,
    stratified_p,
)
from bpn_shared.runs.statistics import merge_seeds

scores = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=12).map(np.array)
tied = st.lists(st.integers(-3, 3).map(float), min_size=1, max_size=12).map(np.array)
strata = st.lists(scores, min_size=1, max_size=3)


@given(strata)
def test_interquartile_mean_is_scipys_of_all_scores_together(parts) -> None:
    found = iqm_with_interval(parts)
    pooled = np.concatenate(parts)
    assert found.value == pytest.approx(stats.trim_mean(pooled, 0.25), rel=1e-9, abs=1e-6)
    assert mean_with_interval(parts).value == pytest.approx(pooled.mean(), rel=1e-9, abs=1e-6)
    if max(map(len, parts)) == 1:
        assert math.isnan(found.low)
    else:
        assert pooled.min() - 1e-6 <= found.low <= found.high <= pooled.max() + 1e-6


@pytest.mark.parametrize("sizes", [(6,), (5, 9), (8, 12, 7)])
def test_stratified_intervals_are_scipys(sizes) -> None:
    """SciPy's bootstrap of several samples draws each for itself: strata."""
    rng = np.random.default_rng(len(sizes))
    parts = [rng.normal(10 * place, 1.0, n) for place, n in enumerate(sizes)]

    def iqm(*drawn, axis):
        return stats.trim_mean(np.concatenate(drawn, axis=-1), 0.25, axis=axis)

    expected = stats.bootstrap(
        parts, iqm, n_resamples=20_000, method="percentile", vectorized=True, rng=rng
    ).confidence_interval
    found = iqm_with_interval(parts)
    width = expected.high - expected.low
    assert found.low == pytest.approx(expected.low, abs=0.1 * width)
    assert found.high == pytest.approx(expected.high, abs=0.1 * width)


@given(st.one_of(scores, tied), st.one_of(scores, tied))
def test_probability_of_improvement_is_the_share_of_pairs_that_win(one, other) -> None:
    u = stats.mannwhitneyu(one, other, method="asymptotic").statistic
    found = probability_of_improvement([one], [other])
    assert found.value == pytest.approx(u / (len(one) * len(other)))
    turned = probability_of_improvement([other], [one])
    assert found.value + turned.value == pytest.approx(1.0)
    if max(len(one), len(other)) > 1:
        assert 0.0 <= found.low <= found.high <= 1.0


def test_the_interval_of_the_probability_of_improvement_is_scipys() -> None:
    rng = np.random.default_rng(3)
    one, other = rng.normal(0.6, 1, 9), rng.normal(0, 1, 7)

    def share(x, y, axis):
        assert axis == -1
        return (x[..., :, None] > y[..., None, :]).mean(axis=(-1, -2))

    expected = stats.bootstrap(
        (one, other), share, n_resamples=20_000, method="percentile", vectorized=True, rng=rng
    ).confidence_interval
    found = probability_of_improvement([one], [other])
    assert found.low == pytest.approx(expected.low, abs=0.04)
    assert found.high == pytest.approx(expected.high, abs=0.04)


@settings(max_examples=60)
@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 2**32))
def test_the_exact_rank_sum_test_is_scipys(m, n, seed) -> None:
    drawn = np.random.default_rng(seed).permutation(m + n).astype(float)
    one, other = drawn[:m], drawn[m:]
    expected = stats.mannwhitneyu(one, other, method="exact").pvalue
    assert rank_sum_p(one, other) == pytest.approx(expected)
    assert rank_sum_p(one, other) >= least_p(m, n) - 1e-12


@given(tied, tied)
def test_with_ties_the_test_is_scipys_approximation(one, other) -> None:
    if len(np.unique(np.concatenate([one, other]))) == len(one) + len(other):
        return
    expected = stats.mannwhitneyu(one, other, method="asymptotic").pvalue
    expected = 1.0 if np.isnan(expected) else expected  # all the same
    assert rank_sum_p(one, other) == pytest.approx(expected)


def test_three_seeds_against_three_can_show_nothing_at_five_percent() -> None:
    assert rank_sum_p(np.array([7.0, 8, 9]), np.array([1.0, 2, 3])) == pytest.approx(0.1)
    assert (least_p(3, 3), least_p(4, 4) < 0.05) == (pytest.approx(0.1), True)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_holds_every_test_to_the_number_of_tests(ps) -> None:
    adjusted = holm(ps)
    assert all(a >= p for a, p in zip(adjusted, ps, strict=True))
    assert adjusted[ps.index(min(ps))] == pytest.approx(min(1.0, len(ps) * min(ps)))
    order = np.argsort(ps, kind="stable")
    assert (np.diff(np.array(adjusted)[order]) >= 0).all()


@given(strata, st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=9).map(np.array))
def test_a_profile_is_one_less_the_empirical_distribution(parts, thresholds) -> None:
    found = performance_profile(parts, thresholds)
    ecdf = stats.ecdf(np.concatenate(parts)).cdf.evaluate(thresholds)
    np.testing.assert_allclose(found.share, 1 - ecdf, atol=1e-12)
    if sum(map(len, parts)) > 1:
        assert ((found.low <= found.share + 1e-9) | (found.low <= found.high)).all()
        assert ((found.low >= 0) & (found.high <= 1)).all()


@given(scores, st.integers(2, 5))
def test_a_seed_that_was_made_often_changes_nothing(one, times) -> None:
    """What is compared are seeds: duplicates are averaged first, and NaN are not there."""
    seeds = [*range(len(one)), *[0] * times]
    rows = np.concatenate([one, np.full(times, one[0])])[:, np.newaxis]
    merged = merge_seeds(seeds, rows)[:, 0]
    assert iqm_with_interval([merged]).value == pytest.approx(
        iqm_with_interval([one]).value, rel=1e-9, abs=1e-6
    )


def test_differences_are_between_interquartile_means_with_both_spreads() -> None:
    rng = np.random.default_rng(1)
    one, other = rng.normal(5, 1, 20), rng.normal(3, 1, 20)
    found = iqm_difference([one], [other])
    assert found.value == pytest.approx(stats.trim_mean(one, 0.25) - stats.trim_mean(other, 0.25))
    assert 0 < found.low < found.value < found.high
    single = iqm_difference([one[:1]], [other[:1]])
    assert math.isnan(single.low)


def test_an_interval_is_the_same_whenever_it_is_asked_for() -> None:
    part = [np.arange(7.0)]
    before = iqm_with_interval(part)
    comparison._drawn.cache_clear()
    assert iqm_with_interval(part) == before


@pytest.mark.parametrize("ask", [iqm_with_interval, mean_with_interval])
def test_nothing_has_no_statistic(ask) -> None:
    for empty in ([], [np.array([])]):
        with pytest.raises(ValueError, match="no scores"):
            ask(empty)


@given(tied, tied)
def test_of_one_stratum_the_test_is_the_rank_sum_test(one, other) -> None:
    assert stratified_p([one], [other]) == rank_sum_p(one, other)


def test_several_tasks_are_tested_within_each() -> None:
    """Oracle: SciPy's permutation test, which permutes each task's seeds for itself."""
    rng = np.random.default_rng(8)
    ones = [rng.normal(0.8, 1, 5), rng.normal(100.8, 1, 4)]
    others = [rng.normal(0, 1, 4), rng.normal(100, 1, 6)]
    found = stratified_p(ones, others)
    drawn = [
        stats.permutation_test(
            pair, lambda x, y: (x[:, None] > y[None, :]).mean(), n_resamples=np.inf
        ).null_distribution
        for pair in zip(ones, others, strict=True)
    ]
    null = np.abs((drawn[0][:, None] + drawn[1][None, :]) / 2 - 0.5)  # all of both, exactly
    value = probability_of_improvement(ones, others).value
    expected = (null >= abs(value - 0.5) - 1e-12).mean()
    assert found == pytest.approx(expected, abs=0.02)
    assert stratified_p([np.ones(3)] * 2, [np.ones(3)] * 2) == 1.0
