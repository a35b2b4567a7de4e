"""Targets over n steps, at CVI's fixed point of random decision processes and beside sums written out."""

import itertools

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from bpn_learner.cvi import NO_FLOOR, cvi_gap, cvi_target, dqn_target, mellowmax
from bpn_learner.n_step import n_step

STATES = 5


def process(seed: int, actions: int) -> tuple[Tensor, Tensor]:
    """Rewards float64[S, A] and next states int64[S, A]."""
    generator = torch.Generator().manual_seed(seed)
    rewards = torch.randn(STATES, actions, generator=generator, dtype=torch.float64)
    return rewards, torch.randint(STATES, (STATES, actions), generator=generator)


def fixed_point(
    rewards: Tensor, expectation: Tensor, *, alpha: float, beta: float, gamma: float, floor: float
) -> Tensor:
    """P, float64[S, A], where CVI's update changes nothing; `expectation` is float64[S, A, S]."""
    P = torch.zeros_like(rewards)
    for _ in range(3000):
        m = mellowmax(P, beta)
        gap = (P - m[:, None]).clamp_min(-floor)
        after = rewards + gamma * expectation @ m + alpha * gap
        if torch.equal(after, P):
            break
        P = after
    return P


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    actions=st.integers(2, 5),
    n=st.integers(1, 12),
    alpha=st.floats(0, 0.95),
    beta=st.floats(0.1, 10),
    gamma=st.floats(0, 0.95),
    floor=st.sampled_from([NO_FLOOR, 0.5, 3.0]),
)
def test_at_the_fixed_point_any_actions_targets_are_the_preferences(
    seed: int, actions: int, n: int, alpha: float, beta: float, gamma: float, floor: float
) -> None:
    rewards, nexts = process(seed, actions)
    expectation = torch.nn.functional.one_hot(nexts, STATES).double()
    P = fixed_point(rewards, expectation, alpha=alpha, beta=beta, gamma=gamma, floor=floor)
    generator = torch.Generator().manual_seed(seed + 1)
    s, states, lengths = 0, [], (7, 1, 13)
    taken = torch.randint(actions, (sum(lengths),), generator=generator)
    for a in taken.tolist():
        states.append(s)
        s = int(nexts[s, a])
    before, after = torch.tensor(states), nexts[states, taken]
    left = torch.cat([torch.arange(length, 0, -1) for length in lengths])
    gap, floored = cvi_gap(P[before], taken, beta=beta, floor=floor)
    steps = n_step(rewards[before, taken], left, n, gamma, gap - alpha * floored)
    y = cvi_target(
        steps.reward, P[before], taken, P[after][steps.last],
        alpha=alpha, beta=beta, gamma=steps.discount, floor=floor,
    )  # fmt: skip
    assert (y - P[before, taken]).abs().max() < 1e-10


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32), n=st.integers(1, 3), alpha=st.floats(0, 0.9))
def test_where_chance_decides_the_next_state_their_mean_is_the_preference(
    seed: int, n: int, alpha: float
) -> None:
    actions, beta, gamma, states = 2, 1.0, 0.8, 3
    generator = torch.Generator().manual_seed(seed)
    rewards = torch.randn(states, actions, generator=generator, dtype=torch.float64)
    chances = torch.rand(states, actions, states, generator=generator, dtype=torch.float64)
    chances /= chances.sum(-1, keepdim=True)
    P = torch.zeros_like(rewards)
    for _ in range(3000):
        m = mellowmax(P, beta)
        P = rewards + gamma * chances @ m + alpha * (P - m[:, None])
    taken = torch.randint(actions, (n,), generator=generator)
    mean = torch.zeros((), dtype=torch.float64)
    for path in itertools.product(range(states), repeat=n):
        visited = torch.tensor([0, *path])
        before, after = visited[:-1], visited[1:]
        chance = chances[before, taken, after].prod()
        gap, _ = cvi_gap(P[before], taken, beta=beta)
        left = torch.arange(n, 0, -1)
        steps = n_step(rewards[before, taken], left, n, gamma, (1 - alpha) * gap)
        y = cvi_target(
            steps.reward, P[before], taken, P[after][steps.last],
            alpha=alpha, beta=beta, gamma=steps.discount,
        )  # fmt: skip
        mean += chance * y[0]
    assert mean == pytest.approx(float(P[0, taken[0]]), abs=1e-10)


@given(
    seed=st.integers(0, 2**32),
    lengths=st.lists(st.integers(1, 6), min_size=1, max_size=5),
    n=st.integers(1, 8),
    gamma=st.floats(0, 1),
)
def test_sums_end_with_their_episode(seed: int, lengths: list[int], n: int, gamma: float) -> None:
    generator = torch.Generator().manual_seed(seed)
    reward, correction = torch.randn(2, sum(lengths), generator=generator, dtype=torch.float64)
    left = torch.cat([torch.arange(length, 0, -1) for length in lengths])
    steps = n_step(reward, left, n, gamma, correction)
    for i in range(len(reward)):
        length = min(n, int(left[i]))
        terms = [
            gamma**k * float(reward[i + k] - (correction[i + k] if k else 0)) for k in range(length)
        ]
        assert float(steps.reward[i]) == pytest.approx(sum(terms), abs=1e-9)
        assert int(steps.last[i]) == i + length - 1
        assert float(steps.discount[i]) == pytest.approx(gamma**length)


@given(seed=st.integers(0, 2**32), gamma=st.floats(0, 0.999))
def test_one_step_is_the_papers_target_bit_by_bit(seed: int, gamma: float) -> None:
    generator = torch.Generator().manual_seed(seed)
    reward = torch.randn(20, generator=generator)
    P_s, P_next = torch.randn(2, 20, 4, generator=generator)
    action = torch.randint(4, (20,), generator=generator)
    done = torch.rand(20, generator=generator) < 0.3
    left = torch.tensor([20 - i for i in range(20)])
    gap, _ = cvi_gap(P_s, action, beta=1.0)
    steps = n_step(reward, left, 1, gamma, 0.05 * gap)
    rule = {"alpha": 0.95, "beta": 1.0, "done": done, "terminal": -3.0}
    paper = cvi_target(reward, P_s, action, P_next, gamma=gamma, **rule)
    of_one = cvi_target(steps.reward, P_s, action, P_next[steps.last], gamma=steps.discount, **rule)
    assert torch.equal(of_one, paper)
    dqn = dqn_target(steps.reward, P_next[steps.last], gamma=steps.discount, done=done)
    assert torch.equal(dqn, dqn_target(reward, P_next, gamma=gamma, done=done))


def test_no_step_is_refused() -> None:
    with pytest.raises(ValueError, match="n_step = 0"):
        n_step(torch.zeros(1), torch.ones(1, dtype=torch.int64), 0, 0.9)
