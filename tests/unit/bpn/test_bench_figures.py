import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn.bench.figures import Figure, all_met, told_only
from bpn.bench.live import median_interval


@pytest.mark.parametrize(
    ("n", "ranks"),
    [
        (6, (1, 6)),
        (8, (1, 8)),
        (9, (2, 8)),
        (10, (2, 9)),
        (20, (6, 15)),
        (30, (10, 21)),
        (40, (14, 27)),
    ],
)
def test_the_interval_has_the_ranks_of_the_printed_tables(n: int, ranks: tuple[int, int]) -> None:
    """Ranks of the 95 % interval of a median, as Conover's and Altman's tables print them."""
    values = [float(rank) for rank in range(n, 0, -1)]
    assert median_interval(values) == ranks


def test_few_values_have_no_interval() -> None:
    assert [median_interval([0.0] * n) for n in range(6)] == [None] * 6


@given(st.integers(6, 200))
def test_the_interval_misses_the_median_rarely(n: int) -> None:
    """Counted over all ways in which values can lie below and above the true median."""
    low, high = median_interval(list(range(n))) or (math.nan, math.nan)
    cut = int(low)
    assert high == n - 1 - cut
    missed = sum(2 * math.comb(n, below) for below in range(cut + 1)) / 2**n
    assert missed <= 0.05 < missed + 2 * math.comb(n, cut + 1) / 2**n


@pytest.mark.parametrize(
    ("figure", "value", "met"),
    [
        (Figure("a", "a", 2.0), 2.0, True),
        (Figure("a", "a", 2.0), 2.1, False),
        (Figure("a", "a", 2.0, "least"), 1.9, False),
        (Figure("a", "a", 2.0, "within"), -2.1, False),
        (Figure("a", "a", 2.0, "within"), -1.9, True),
        (Figure("a", "a"), 1e9, None),
    ],
)
def test_a_figure_is_told_with_its_verdict(figure: Figure, value: float, met: bool | None) -> None:
    told = figure.result(value)
    assert told["met"] is met
    assert all_met([told]) is (met is not False)


def test_a_quick_measurement_is_told_and_not_judged() -> None:
    missed = [Figure("a", "a", 2.0).result(9.0)]
    (told,) = told_only(missed)
    assert (told["value"], told["target"], told["met"]) == (9.0, None, None)
    assert all_met([told])
    assert not all_met(missed)
