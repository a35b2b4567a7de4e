"""Every action space as choices: each choice is an action of the space, and all of a dimension differ."""

import itertools
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Text
from hypothesis import given
from hypothesis import strategies as st

from bpn_robot_sim.action_choices import ActionChoices, choices_of
from bpn_shared.spec.config import ConfigError

NAME = "gym:Some-v0"


def first_choices(choices: ActionChoices, most: int = 200) -> list[tuple[int, ...]]:
    return list(itertools.islice(itertools.product(*map(range, choices.dims)), most))


@st.composite
def discrete_spaces(draw: st.DrawFn) -> Any:
    kind = draw(st.sampled_from(("Discrete", "MultiDiscrete", "MultiBinary")))
    if kind == "Discrete":
        return Discrete(draw(st.integers(2, 64)), start=draw(st.integers(-(2**40), 2**40)))
    if kind == "MultiBinary":
        return MultiBinary(draw(st.one_of(st.integers(1, 5), st.just([2, 2]))))
    counts = draw(st.lists(st.integers(2, 64), min_size=1, max_size=6))
    shape = (len(counts) // 2, 2) if len(counts) % 2 == 0 and draw(st.booleans()) else (-1,)
    start = np.array([draw(st.integers(-9, 9)) for _ in counts])
    return MultiDiscrete(np.reshape(counts, shape), start=start.reshape(shape))


@given(discrete_spaces())
def test_choices_of_discrete_spaces_are_their_actions(space: Any) -> None:
    try:
        choices = choices_of(space, NAME, 0)
    except ConfigError as error:
        assert "choices together" in str(error)  # noqa: PT017 - what is drawn may be too large
        assert sum(getattr(space, "nvec", np.zeros(0)).flat) > 64
        return
    made = [choices.action(chosen) for chosen in first_choices(choices)]
    assert all(space.contains(action) for action in made)
    assert len({np.asarray(action).tobytes() for action in made}) == len(made)


@st.composite
def boxes(draw: st.DrawFn) -> Box:
    count = draw(st.integers(1, 3))
    kind = draw(st.sampled_from((np.float32, np.float64, np.int32)))
    if kind == np.int32:
        ends = st.integers(-(2**31), 2**31 - 1)
    else:
        ends = st.floats(allow_nan=False, allow_infinity=False, width=32)
    pairs = [sorted((draw(ends), draw(ends))) for _ in range(count)]
    lows, highs = zip(*pairs, strict=True)
    return Box(np.array(lows, kind), np.array(highs, kind), dtype=kind)


@given(boxes(), st.integers(2, 9))
def test_bins_are_in_the_space_rise_and_reach_both_ends(space: Box, bins: int) -> None:
    if space.dtype == np.int32 and (space.low == space.high).any():
        with pytest.raises(ConfigError, match=r"has 1 actions, a policy has 2\.\.64"):
            choices_of(space, NAME, bins)
        return
    choices = choices_of(space, NAME, bins)
    for place, count in enumerate(choices.dims):
        chosen = [[0] * len(choices.dims) for _ in range(count)]
        for number, one in enumerate(chosen):
            one[place] = number
        actions = [choices.action(one) for one in chosen]
        assert all(space.contains(action) for action in actions)
        values = [action[place] for action in actions]
        assert values == sorted(values)
        assert (values[0], values[-1]) == (space.low[place], space.high[place])
        assert count == bins or space.dtype == np.int32


def test_an_odd_number_of_bins_has_the_middle() -> None:
    choices = choices_of(Box(-2.0, 2.0, (1,), np.float32), NAME, 5)
    assert [float(choices.action([n])[0]) for n in range(5)] == [-2.0, -1.0, 0.0, 1.0, 2.0]


def test_without_a_number_of_bins_there_are_lowest_middle_and_highest() -> None:
    choices = choices_of(Box(-1.0, 3.0, (2,), np.float32), NAME, 0)
    assert choices.dims == (3, 3)
    assert choices.action([0, 1]).tolist() == [-1.0, 1.0]


@pytest.mark.parametrize(
    ("space", "bins", "sentence"),
    [
        (Box(-1, 1, (9,)), 9, "9 dimensions with 81 choices together .*choose fewer action_bins"),
        (MultiBinary(33), 0, "66 choices together .*wrap it with env_wrappers"),
        (Box(-np.inf, np.inf, (1,)), 5, "whose range has no end that action_bins could reach"),
        (Box(-1, 1, (1,)), 1, "has 1 actions, a policy has 2..64"),
        (Box(3, 4, (1,), np.int64), 9, None),
        (Discrete(65), 0, "has 65 actions, a policy has 2..64"),
        (Discrete(1), 0, "has 1 actions, a policy has 2..64"),
        (Discrete(3), 5, "which are discrete already: leave action_bins out"),
        (MultiDiscrete([3, 65]), 0, "has 65 actions"),
        (
            Dict({"a": Discrete(2)}),
            0,
            "Discrete, MultiDiscrete, MultiBinary and Box can be learned",
        ),
        (Text(5), 0, "Discrete, MultiDiscrete, MultiBinary and Box can be learned"),
    ],
)
def test_what_cannot_be_chosen_is_refused_by_name(
    space: Any, bins: int, sentence: str | None
) -> None:
    if sentence is None:
        assert choices_of(space, NAME, bins).dims == (2,)
        return
    with pytest.raises(ConfigError, match=sentence):
        choices_of(space, NAME, bins)
