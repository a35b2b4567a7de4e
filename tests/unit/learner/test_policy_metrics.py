import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.policy_metrics import agreement, entropy


@given(st.lists(st.integers(2, 6), min_size=1, max_size=4), st.floats(0.1, 10))
def test_a_policy_without_preferences_has_the_largest_entropy(dims: list[int], beta: float) -> None:
    P = torch.zeros(3, sum(dims))
    assert entropy(P, beta, dims) == pytest.approx(math.log(math.prod(dims)))
    assert entropy(1e4 * torch.eye(sum(dims))[:1], beta, dims) <= math.log(math.prod(dims))


@given(st.integers(0, 2**32), st.floats(0.1, 5))
def test_entropy_is_its_definition(seed: int, beta: float) -> None:
    P = torch.randn(4, 5, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    pi = torch.softmax(beta * P, -1)
    assert entropy(P, beta) == pytest.approx(float(-(pi * pi.log()).sum(-1).mean()))


def test_agreement_counts_states_whose_joint_action_is_the_same() -> None:
    before = torch.tensor([[1.0, 0, 0, 1], [1, 0, 1, 0], [0, 1, 1, 0]])
    after = torch.tensor([[9.0, 1, 0, 1], [1, 0, 0, 1], [0, 1, 5, 0]])
    assert agreement(before, after, [2, 2]) == pytest.approx(2 / 3)
    assert agreement(before, before) == 1
