import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.spec.seeds import (
    action_uniforms,
    episode_seed,
    initial_weights_seed,
    shuffle_generator,
)

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


@given(st.integers(0, 2**64 - 1), st.integers(1, 1000))
def test_a_steps_number_does_not_depend_on_how_many_steps_there_are(seed: int, steps: int) -> None:
    numbers = action_uniforms(seed, steps)
    assert ((numbers >= 0) & (numbers < 1)).all()
    assert numbers.tolist() == action_uniforms(seed, 1000)[:steps].tolist()


def test_action_numbers_look_uniform() -> None:
    numbers = np.concatenate([action_uniforms(seed, 50) for seed in range(40)])
    counts_per_decile, _ = np.histogram(numbers, bins=10, range=(0, 1))
    # chi-square with 9 degrees of freedom: above 33.7 once in ten thousand draws; the draws are fixed
    assert ((counts_per_decile - 200) ** 2 / 200).sum() < 33.7


def test_iterations_shuffle_differently() -> None:
    orders = {tuple(shuffle_generator(1, iteration).permutation(20)) for iteration in range(50)}
    assert len(orders) == 50


@given(st.integers(2**63, 2**64 - 2))
def test_large_neighbouring_seeds_have_streams_of_their_own(seed: int) -> None:
    assert action_uniforms(seed, 1) != action_uniforms(seed + 1, 1)


# Published curves come from these numbers: whoever changes one changes all of them, in silence but for this.


@pytest.mark.parametrize(
    ("run", "iteration", "episode", "seed"),
    [
        (0, 0, 0, 259491006799949737),
        (7, 3, 11, 18203938982329963889),
        (2**63 - 1, 99_999, 9_999, 11900429211074164487),
    ],
)
def test_seeds_of_episodes_are_what_they_always_were(
    run: int, iteration: int, episode: int, seed: int
) -> None:
    assert episode_seed(run, iteration, episode) == seed


@pytest.mark.parametrize(
    ("seed", "step", "number"),
    [
        (0, 0, 0.8133540609793564),
        (7, 3, 0.0931189622036861),
        (2**63, 1, 0.4266450573722115),
        (2**64 - 1, 999, 0.08866960441259597),
    ],
)
def test_numbers_of_actions_are_what_they_always_were(seed: int, step: int, number: float) -> None:
    assert action_uniforms(seed, step + 1)[step] == number


@pytest.mark.parametrize(
    ("run", "iteration", "order"),
    [
        (0, 0, [11, 5, 0, 2, 6, 1, 8, 9, 3, 10, 4, 7]),
        (7, 3, [4, 8, 9, 2, 10, 7, 0, 3, 5, 1, 6, 11]),
        (2**63 - 1, 49, [7, 0, 4, 2, 6, 11, 3, 10, 8, 9, 5, 1]),
    ],
)
def test_shuffles_are_what_they_always_were(run: int, iteration: int, order: list[int]) -> None:
    assert shuffle_generator(run, iteration).permutation(12).tolist() == order


@pytest.mark.parametrize(
    ("run", "seed"),
    [(0, 417755456507826275), (7, 3337871971453161004), (2**63 - 1, 6157984029494570297)],
)
def test_seeds_of_initial_weights_are_what_they_always_were(run: int, seed: int) -> None:
    assert initial_weights_seed(run) == seed
