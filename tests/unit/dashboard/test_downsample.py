import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.series.downsample import NO_BUCKETS, Buckets, bucket_width, bucketize

values = st.floats(-1e9, 1e9, width=32)
steps = st.lists(st.integers(0, 100_000), min_size=1, max_size=300, unique=True).map(sorted)
widths = st.integers(0, 18).map(lambda exponent: 2.0**exponent)


@st.composite
def series(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    x = np.array(draw(steps), float)
    y = np.array(draw(st.lists(values, min_size=len(x), max_size=len(x))), float)
    return x, y


@given(series(), widths)
def test_every_bucket_keeps_what_its_points_say(points, width) -> None:
    x, y = points
    buckets = bucketize(x, y, width)
    assert buckets.n.sum() == len(x)
    for k, begin in enumerate(buckets.x):
        inside = y[(x >= begin) & (x < begin + width)]
        assert begin % width == 0
        assert buckets.n[k] == len(inside)
        assert buckets.min[k] == inside.min()
        assert buckets.max[k] == inside.max()
        assert buckets.last[k] == inside[-1]
        assert buckets.mean[k] == pytest.approx(inside.mean(), rel=1e-9, abs=1e-3)


@given(series(), widths, st.data())
def test_closed_buckets_never_change(points, width, data) -> None:
    x, y = points
    shown = data.draw(st.integers(1, len(x)))
    before, after = bucketize(x[:shown], y[:shown], width), bucketize(x, y, width)
    closed = len(before.x) - 1  # all but the one of the newest point
    for name in ("x", "n", "min", "max", "sum", "last"):
        assert getattr(before, name)[:closed].tobytes() == getattr(after, name)[:closed].tobytes()


@given(series(), st.integers(0, 6), st.integers(0, 6))
def test_merging_buckets_is_making_coarser_ones(points, fine, factor) -> None:
    x, y = points
    direct = bucketize(x, y, 2.0 ** (fine + factor))
    merged = bucketize(x, y, 2.0**fine).merge(2.0 ** (fine + factor))
    for name in ("x", "n", "min", "max", "last"):
        np.testing.assert_array_equal(getattr(direct, name), getattr(merged, name))
    np.testing.assert_allclose(direct.sum, merged.sum, rtol=1e-9, atol=1e-3)


@given(st.floats(0, 1e6), st.floats(1e-3, 1e6), st.integers(1, 4000))
def test_width_is_the_smallest_that_is_enough(low, span, max_buckets) -> None:
    high = low + span
    width = bucket_width(low, high, max_buckets)
    assert np.log2(width).is_integer()
    assert high // width - low // width < max_buckets
    half = width / 2
    assert high // half - low // half + 1 > max_buckets or span / half > max_buckets - 1


@given(series())
def test_bytes_hold_all(points) -> None:
    buckets = bucketize(*points, 64)
    again = Buckets.from_bytes(buckets.to_bytes())
    for name in ("x", "n", "min", "max", "sum", "last"):
        np.testing.assert_array_equal(getattr(buckets, name), getattr(again, name))


@given(series(), st.data(), widths)
def test_what_is_not_a_number_counts_nowhere_and_leaves_a_hole(points, data, width) -> None:
    x, y = points
    gone = np.array(data.draw(st.lists(st.booleans(), min_size=len(x), max_size=len(x))))
    holed = bucketize(x, np.where(gone, np.nan, y), width)
    numbers = bucketize(x[~gone], y[~gone], width)
    assert holed.x.tolist() == bucketize(x, y, width).x.tolist()
    full = holed.n > 0
    for name in ("x", "n", "min", "max", "last", "sum"):
        np.testing.assert_array_equal(getattr(holed, name)[full], getattr(numbers, name))
        if name not in ("x", "n"):
            assert np.isnan(getattr(holed, name)[~full]).all()


@given(series(), st.data())
def test_points_at_one_x_share_a_bucket_and_keep_their_extremes(points, data) -> None:
    _, y = points
    at = sorted(data.draw(st.lists(st.integers(0, 5), min_size=len(y), max_size=len(y))))
    buckets = bucketize(np.array(at, float), y)
    assert buckets.x.tolist() == sorted(set(at))
    assert buckets.n.sum() == len(y)
    for k, x in enumerate(buckets.x):
        inside = y[np.array(at) == x]
        assert (buckets.min[k], buckets.max[k]) == (inside.min(), inside.max())
        assert buckets.last[k] == inside[-1]


@given(st.floats(0, 1e9), st.integers(1, 4000))
def test_a_single_point_has_a_bucket_of_width_one(x: float, max_buckets: int) -> None:
    assert bucket_width(x, x, max_buckets) == 1.0


@given(widths)
def test_nothing_merges_and_joins_to_nothing(width: float) -> None:
    empty = bucketize(np.empty(0), np.empty(0), width)
    for nothing in (NO_BUCKETS.merge(width), empty, Buckets.joined([NO_BUCKETS, empty])):
        assert len(nothing.x) == len(nothing.last) == 0
    assert NO_BUCKETS.between(0, 1).to_bytes() == b""


@given(series(), st.floats(0, 1e5), st.floats(0, 1e5))
def test_a_range_has_the_buckets_that_begin_in_it(points, low: float, span: float) -> None:
    buckets = bucketize(*points, 64)
    found = buckets.between(low, low + span)
    kept = (buckets.x >= low) & (buckets.x <= low + span)
    for name in ("x", "n", "min", "max", "sum", "last"):
        np.testing.assert_array_equal(getattr(found, name), getattr(buckets, name)[kept])
