"""Joint actions: the product of the dimensions' policies is the policy of the joint actions."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_edge.factored import epsilon_of_each, joint_selector
from bpn_edge.policy import action_selector, epsilon_greedy_action, softmax_action, softmax_weights
from bpn_shared.messages.control import Assignment
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.joint_actions import parted

seeds = st.integers(0, 2**32)
uniform = st.floats(0, 1, exclude_max=True)
dims_of = st.lists(st.integers(2, 5), min_size=1, max_size=4)


def outputs_of(seed: int, dims: list[int]) -> np.ndarray:
    return np.random.default_rng(seed).integers(-60, 60, sum(dims)).astype(np.int32)


def greedy(outputs: np.ndarray, _: float) -> int:
    return epsilon_greedy_action(outputs, 0.0, 0.5)


@given(seeds, dims_of)
def test_the_greedy_action_is_the_best_joint_one(seed: int, dims: list[int]) -> None:
    outputs = outputs_of(seed, dims)
    starts = np.cumsum([0, *dims[:-1]])
    totals = [
        sum(outputs[s + c] for s, c in zip(starts, choices, strict=True))
        for choices in itertools.product(*map(range, dims))
    ]
    best = joint_selector(greedy, dims)(outputs, [0.5] * len(dims))
    assert totals[best] == max(totals)


@given(seeds, uniform, st.floats(0, 1))
def test_one_dimension_is_as_before(seed: int, u: float, epsilon: float) -> None:
    outputs = outputs_of(seed, [14])
    play = Assignment(status="play", epsilon=epsilon)
    softmax = action_selector(RunConfig.for_task("reaching", beta=2.0), play, 0.1)
    assert softmax(outputs, [u]) == softmax_action(outputs, 0.1, 2.0, u)
    dqn = Assignment(status="play", policy="epsilon_greedy", epsilon=epsilon)
    chosen = action_selector(RunConfig.for_task("reaching", algorithm="bqn"), dqn, 0.1)
    assert chosen(outputs, [u]) == epsilon_greedy_action(outputs, epsilon, u)


def test_each_dimension_is_drawn_by_its_own_softmax() -> None:
    dims, outputs = [3, 2], np.array([4, 0, -3, 1, 2], np.int32)
    grid = (np.arange(200) + 0.5) / 200
    select = joint_selector(lambda own, u: softmax_action(own, 0.3, 1.0, u), dims)
    choices = np.array([parted(select(outputs, [u, v]), dims) for u in grid for v in grid])
    for d, own in enumerate((outputs[:3], outputs[3:])):
        weights = np.array(softmax_weights(own, 0.3, 1.0))
        shares = np.bincount(choices[:, d], minlength=dims[d]) / len(choices)
        assert shares == pytest.approx(weights / weights.sum(), abs=0.006)


@given(st.floats(0, 1), st.integers(1, 9))
def test_epsilon_is_the_share_of_actions_that_are_not_all_greedy(epsilon: float, dims: int) -> None:
    each = epsilon_of_each(epsilon, dims)
    assert 1 - (1 - each) ** dims == pytest.approx(epsilon, abs=1e-9)
    assert epsilon_of_each(epsilon, 1) == epsilon


@pytest.mark.parametrize(("epsilon", "randomly"), [(0.0, False), (1.0, True)])
def test_a_factored_task_explores_in_each_dimension(epsilon: float, randomly: bool) -> None:
    config = RunConfig.for_task("pan_tilt_both", algorithm="bqn")
    play = Assignment(status="play", policy="epsilon_greedy", epsilon=epsilon)
    outputs = np.array([0, 0, 9, 0, 0, 0, 9, 0, 0, 0], np.int32)
    select = action_selector(config, play, 0.1)
    drawn = [select(outputs, pair) for pair in np.random.default_rng(0).random((600, 2)).tolist()]
    assert set(drawn) == (set(range(25)) if randomly else {config.task_spec.dims[1] * 2 + 1})
