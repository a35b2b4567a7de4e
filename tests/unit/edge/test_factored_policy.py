"""Joint actions: the product of the dimensions' policies is the policy of the joint actions."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_edge.factored import epsilon_greedy_joint_action, softmax_joint_action
from bpn_edge.policy import epsilon_greedy_action, softmax_action, softmax_weights
from bpn_shared.spec.joint_actions import parted

seeds = st.integers(0, 2**32)
uniform = st.floats(0, 1, exclude_max=True)
dims_of = st.lists(st.integers(2, 5), min_size=1, max_size=4)


def outputs_of(seed: int, dims: list[int]) -> np.ndarray:
    return np.random.default_rng(seed).integers(-60, 60, sum(dims)).astype(np.int32)


@given(seeds, dims_of)
def test_the_greedy_action_is_the_best_joint_one(seed: int, dims: list[int]) -> None:
    outputs = outputs_of(seed, dims)
    starts = np.cumsum([0, *dims[:-1]])
    totals = [
        sum(outputs[s + c] for s, c in zip(starts, choices, strict=True))
        for choices in itertools.product(*map(range, dims))
    ]
    best = epsilon_greedy_joint_action(outputs, dims, 0.0, [0.5] * len(dims))
    assert totals[best] == max(totals)


@given(seeds, uniform, st.floats(0, 1))
def test_one_dimension_is_as_before(seed: int, u: float, epsilon: float) -> None:
    outputs = outputs_of(seed, [6])
    assert softmax_joint_action(outputs, [6], 0.1, 2.0, [u]) == softmax_action(outputs, 0.1, 2.0, u)
    assert epsilon_greedy_joint_action(outputs, [6], epsilon, [u]) == epsilon_greedy_action(
        outputs, epsilon, u
    )


def test_each_dimension_is_drawn_by_its_own_softmax() -> None:
    dims, outputs = [3, 2], np.array([4, 0, -3, 1, 2], np.int32)
    grid = (np.arange(200) + 0.5) / 200
    drawn = [softmax_joint_action(outputs, dims, 0.3, 1.0, [u, v]) for u in grid for v in grid]
    choices = np.array([parted(action, dims) for action in drawn])
    for d, own in enumerate((outputs[:3], outputs[3:])):
        weights = np.array(softmax_weights(own, 0.3, 1.0))
        shares = np.bincount(choices[:, d], minlength=dims[d]) / len(choices)
        assert shares == pytest.approx(weights / weights.sum(), abs=0.006)
