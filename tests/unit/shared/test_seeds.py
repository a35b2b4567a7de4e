import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.seeds import action_uniform, episode_seed, initial_weights_seed, shuffle_generator

runs = st.integers(0, 2**63 - 1)
counts = st.integers(0, 2**31)


@given(runs, counts, counts)
def test_seeds_are_functions_of_where_they_are_used(run: int, i: int, e: int) -> None:
    assert episode_seed(run, i, e) == episode_seed(run, i, e)
    assert (
        len({episode_seed(run, i, e), episode_seed(run, i, e + 1), episode_seed(run + 1, i, e)})
        == 3
    )
    assert 0 <= episode_seed(run, i, e) < 2**64


@given(st.integers(0, 2**64 - 1), counts)
def test_action_numbers_are_in_range_and_repeat(seed: int, step: int) -> None:
    assert 0 <= action_uniform(seed, step) < 1
    assert action_uniform(seed, step) == action_uniform(seed, step)


def test_action_numbers_look_uniform() -> None:
    numbers = [action_uniform(seed, step) for seed in range(40) for step in range(50)]
    counts_per_decile, _ = np.histogram(numbers, bins=10, range=(0, 1))
    # chi-square with 9 degrees of freedom: above 33.7 once in ten thousand draws; the draws are fixed
    assert ((counts_per_decile - 200) ** 2 / 200).sum() < 33.7


def test_iterations_shuffle_differently() -> None:
    orders = {tuple(shuffle_generator(1, iteration).permutation(20)) for iteration in range(50)}
    assert len(orders) == 50


@given(st.integers(2**63, 2**64 - 2))
def test_large_neighbouring_seeds_have_streams_of_their_own(seed: int) -> None:
    assert action_uniform(seed, 0) != action_uniform(seed + 1, 0)


def test_every_stream_has_the_numbers_that_published_runs_were_made_with() -> None:
    assert episode_seed(1, 2, 3) == 5693582132046763347
    assert [action_uniform(5, 0), action_uniform(5, 1)] == [0.7176855231898798, 0.2162980986424735]
    assert action_uniform(2**64 - 1, 7) == 0.7388619881469085
    assert shuffle_generator(1, 2).permutation(6).tolist() == [2, 4, 5, 1, 3, 0]
    assert [initial_weights_seed(0), initial_weights_seed(1)] == [
        417755456507826275,
        7907067049801683234,
    ]
