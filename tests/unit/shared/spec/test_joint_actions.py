import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.spec.joint_actions import all_parted, count, joined, parted
from bpn_shared.spec.seeds import action_uniforms, choice_uniforms

dims_of = st.lists(st.integers(2, 7), min_size=1, max_size=6)


@given(dims_of, st.data())
def test_a_number_is_its_choices_as_numpy_counts(dims: list[int], data: st.DataObject) -> None:
    action = data.draw(st.integers(0, count(dims) - 1))
    choices = parted(action, dims)
    assert choices == tuple(int(c) for c in np.unravel_index(action, dims))
    assert joined(choices, dims) == action
    assert all_parted(np.array([action, 0]), dims).tolist() == [list(choices), [0] * len(dims)]


@given(st.integers(2, 64))
def test_of_one_dimension_the_choice_is_the_action(choices: int) -> None:
    assert [joined([a], [choices]) for a in range(choices)] == list(range(choices))


def test_what_is_no_action_is_refused() -> None:
    with pytest.raises(ValueError, match=r"choice 3 of dimension 1 is outside 0\.\.2"):
        joined([0, 3], [2, 3])
    with pytest.raises(ValueError, match=r"action 6 is outside 0\.\.5"):
        parted(6, [2, 3])


@given(st.integers(0, 2**64 - 1), st.integers(1, 9))
def test_the_first_dimension_draws_what_one_alone_would(seed: int, dims: int) -> None:
    drawn = choice_uniforms(seed, 5, dims)
    assert drawn.shape == (5, dims)
    if dims <= 4:
        assert np.array_equal(drawn[:, 0], action_uniforms(seed, 5))
    assert np.array_equal(drawn[:3], choice_uniforms(seed, 3, dims))
    assert len(np.unique(drawn)) == drawn.size
