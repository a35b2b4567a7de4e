import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bpn_dashboard.series.downsample import bucketize
from bpn_dashboard.series.statistics import _percentile, _resampled_weights
from bpn_dashboard.series.statistics import summarize as summarize_runs

matrices = st.integers(1, 12).flatmap(
    lambda seeds: st.lists(
        st.lists(st.floats(-1e6, 1e6), min_size=7, max_size=7), min_size=seeds, max_size=seeds
    )
)


def summarize(runs, statistic, band):
    """Of runs that all have seeds of their own."""
    return summarize_runs(runs, range(len(runs)), statistic, band)


def seeds_of(matrix):
    x = np.arange(len(matrix[0]), dtype=float)
    return [bucketize(x, np.array(row)) for row in matrix]


@given(matrices)
def test_mean_median_and_bands_are_numpys(matrix) -> None:
    array, seeds = np.array(matrix), seeds_of(matrix)
    exact = {"rtol": 1e-9, "atol": 1e-9}
    mean = summarize(seeds, "mean", "std")
    np.testing.assert_allclose(mean.value, array.mean(axis=0), **exact)
    np.testing.assert_allclose(
        summarize(seeds, "median", "std").value, np.median(array, axis=0), **exact
    )
    np.testing.assert_array_equal(mean.n, len(array))
    np.testing.assert_array_equal(mean.min, array.min(axis=0))
    np.testing.assert_array_equal(mean.max, array.max(axis=0))
    if len(array) == 1:
        assert np.isnan(mean.low).all()
        return
    std = array.std(axis=0, ddof=1)
    np.testing.assert_allclose(mean.high - mean.low, 2 * std, rtol=1e-9, atol=1e-6)
    sem = summarize(seeds, "mean", "sem")
    np.testing.assert_allclose(
        sem.high - sem.low, 2 * std / np.sqrt(len(array)), rtol=1e-9, atol=1e-6
    )


@given(matrices)
def test_iqm_is_the_mean_without_a_quarter_at_either_end(matrix) -> None:
    array = np.sort(np.array(matrix), axis=0)
    cut = int(0.25 * len(array))
    oracle = np.mean(array[cut : len(array) - cut], axis=0)
    result = summarize(seeds_of(matrix), "iqm", "minmax")
    np.testing.assert_allclose(result.value, oracle, rtol=1e-9, atol=1e-9)


@given(matrices, st.sampled_from(["mean", "median", "iqm"]), st.randoms())
def test_the_order_of_the_seeds_does_not_matter(matrix, statistic, random) -> None:
    shuffled = list(matrix)
    random.shuffle(shuffled)
    for band in ("std", "sem", "ci95", "minmax"):
        one = summarize(seeds_of(matrix), statistic, band)
        other = summarize(seeds_of(shuffled), statistic, band)
        for name in ("value", "low", "high", "last", "n"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_seeds_are_aligned_and_counted_while_they_live() -> None:
    long = bucketize(np.array([0.0, 1, 2, 3, 4]), np.array([0.0, 10, 20, 30, 40]))
    sparse = bucketize(np.array([1.0, 3.0]), np.array([100.0, 300.0]))
    curve = summarize([long, sparse], "mean", "minmax")
    assert curve.x.tolist() == [0, 1, 2, 3, 4]
    assert curve.n.tolist() == [1, 2, 2, 2, 1]
    assert curve.value.tolist() == [0, 55, 60, 165, 40]  # at 2 the sparse one still has 100
    assert curve.high.tolist() == [0, 100, 20, 300, 40]


def test_bootstrap_covers_the_mean_of_normal_seeds() -> None:
    """Oracle: 1.96 standard errors, which the bootstrap of 40 normal values comes close to."""
    array = np.random.default_rng(5).normal(3.0, 2.0, (40, 400))
    curve = summarize(seeds_of(array), "mean", "ci95")
    covered = (curve.low < 3.0) & (curve.high > 3.0)
    assert 0.88 < covered.mean() < 0.99
    widths = (curve.high - curve.low) / (array.std(axis=0, ddof=1) / np.sqrt(40))
    assert widths.mean() == pytest.approx(2 * 1.96, rel=0.05)


def test_a_group_of_nothing_is_an_empty_curve() -> None:
    curve = summarize([], "iqm", "ci95")
    assert len(curve.x) == len(curve.value) == len(curve.low) == 0


@given(matrices, st.sampled_from(["mean", "median", "iqm"]), st.integers(2, 5))
def test_a_seed_that_was_made_many_times_counts_once(matrix, statistic, times) -> None:
    """Wider bands than these are what one seed's repetitions would hide."""
    runs = seeds_of(matrix)
    once = summarize(runs, statistic, "sem")
    seeds = [*range(len(runs)), *[0] * times]
    often = summarize_runs([*runs, *[runs[0]] * times], seeds, statistic, "sem")
    np.testing.assert_array_equal(often.n, len(matrix))
    for name in ("value", "low", "high", "last"):
        expected, found = getattr(once, name), getattr(often, name)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(
    ("statistic", "oracle"),
    [("mean", np.mean), ("iqm", lambda v, axis: stats.trim_mean(v, 0.25, axis=axis))],
)
@pytest.mark.parametrize("n", [5, 12])
def test_confidence_intervals_are_scipys(statistic, oracle, n) -> None:
    """SciPy draws its own resamples, 20 times as many: the edges agree as far as 500 allow, over 60 samples."""
    array = np.random.default_rng(n).normal(0.0, 1.0, (n, 60))
    curve = summarize(seeds_of(array), statistic, "ci95")
    found = stats.bootstrap(
        (array,), oracle, axis=0, n_resamples=10_000, method="percentile",
        rng=np.random.default_rng(1), vectorized=True,
    ).confidence_interval  # fmt: skip
    width = found.high - found.low
    for own, scipys in ((curve.low, found.low), (curve.high, found.high)):
        assert (np.abs(own - scipys) < 0.25 * width).all()
        assert abs(np.mean((own - scipys) / width)) < 0.1  # the same resamples serve all


@pytest.mark.parametrize("statistic", ["mean", "median", "iqm"])
def test_a_bootstrap_is_the_same_in_every_dashboard(statistic: str) -> None:
    """Or a band would change when the page is drawn again."""
    drawn = _resampled_weights(5, statistic)
    _resampled_weights.cache_clear()
    again = _resampled_weights(5, statistic)
    assert again is not drawn
    np.testing.assert_array_equal(again, drawn)
    np.testing.assert_allclose(drawn.sum(axis=1), 1.0)


@pytest.mark.parametrize("band", ["std", "sem", "ci95"])
def test_one_seed_has_no_band(band: str) -> None:
    curve = summarize(seeds_of([[1.0, 2.0]]), "mean", band)
    assert curve.value.tolist() == [1.0, 2.0]
    assert np.isnan([curve.low, curve.high]).all()


def test_the_newest_values_are_those_of_the_last_point_up_to_there() -> None:
    """A bucket's mean and its last value differ; between its points a run keeps its newest."""
    coarse = bucketize(np.arange(4.0), np.array([1.0, 3.0, 5.0, 9.0]), width=2.0)
    fine = bucketize(np.arange(4.0), np.array([10.0, 20.0, 30.0, 40.0]))
    curve = summarize_runs([coarse], [0], "mean", "std")
    assert (curve.value.tolist(), curve.last.tolist()) == ([2.0, 7.0], [3.0, 9.0])
    both = summarize_runs([coarse, fine], [0, 1], "mean", "std")
    assert both.x.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert both.last[:3].tolist() == [(3 + 10) / 2, (3 + 20) / 2, (9 + 30) / 2]
    assert both.n.tolist() == [2.0, 2.0, 2.0, 1.0]


@given(st.integers(2, 600), st.integers(1, 4), st.floats(0, 0.999), st.integers(0, 2**32))
def test_percentiles_are_numpys(n: int, rows: int, share: float, seed: int) -> None:
    ordered = np.sort(np.random.default_rng(seed).normal(size=(rows, n)), axis=1)
    expected = np.percentile(ordered, 100 * share, axis=1)
    np.testing.assert_allclose(_percentile(ordered, share), expected, rtol=0, atol=1e-9)
