"""Preferences of actions with several dimensions, beside those of all joint actions written out."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from minibatches import binary_network, data, distance, float_network, named_gradients
from torch import Tensor

from bpn_learner.cvi import best, cvi_gap, cvi_target, dqn_target, mellowmax, outputs_taken, taken
from bpn_learner.minibatch import (
    autograd_gradients,
    available_paths,
    native_float_gradients,
    native_gradients,
)
from bpn_learner.networks import BinaryNetwork, PNetwork
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import UpdateConfig, make_optimizer, policy_update, preferences
from bpn_shared.spec.network import NetworkSpec

dims_of = st.lists(st.integers(2, 5), min_size=1, max_size=4)


def drawn(seed: int, rows: int, dims: list[int]) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    P = 3 * torch.randn(rows, sum(dims), generator=generator, dtype=torch.float64)
    actions = [torch.randint(n, (rows,), generator=generator) for n in dims]
    return P, torch.stack(actions, dim=1)


def joint(P: Tensor, dims: list[int]) -> tuple[Tensor, list[tuple[int, ...]]]:
    """P(s,a) of every joint action [B, product of dims], and the joint actions in that order."""
    parts = torch.split(P, dims, dim=1)
    actions = list(itertools.product(*map(range, dims)))
    columns = [sum(p[:, c] for p, c in zip(parts, a, strict=True)) for a in actions]
    return torch.stack([torch.as_tensor(c) for c in columns], dim=1), actions


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**32), dims=dims_of, beta=st.floats(0.01, 100))
def test_every_operator_is_that_of_the_joint_actions(
    seed: int, dims: list[int], beta: float
) -> None:
    P, action = drawn(seed, 6, dims)
    whole, actions = joint(P, dims)
    number = torch.tensor([actions.index(tuple(a)) for a in action.tolist()])
    close = {"rtol": 0.0, "atol": 1e-9 * max(1.0, 1 / beta)}
    torch.testing.assert_close(mellowmax(P, beta, dims), mellowmax(whole, beta), **close)
    torch.testing.assert_close(best(P, dims), whole.amax(-1), **close)
    torch.testing.assert_close(taken(P, action, dims), taken(whole, number), **close)
    by_dimension = [torch.softmax(beta * part, -1) for part in torch.split(P, dims, 1)]
    product, _ = joint(torch.cat([p.log() for p in by_dimension], dim=1), dims)
    torch.testing.assert_close(
        product.exp(), torch.softmax(beta * whole, -1), rtol=1e-9, atol=1e-12
    )
    gap, floored = cvi_gap(P, action, beta=beta, floor=0.5, dims=dims)
    of_joint = cvi_gap(whole, number, beta=beta, floor=0.5)
    torch.testing.assert_close(gap, of_joint[0], **close)
    torch.testing.assert_close(floored, of_joint[1], **close)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), dims=dims_of, alpha=st.floats(0, 1), gamma=st.floats(0, 0.99))
def test_targets_are_those_of_the_joint_actions(
    seed: int, dims: list[int], alpha: float, gamma: float
) -> None:
    P, action = drawn(seed, 5, dims)
    P_next, _ = drawn(seed + 1, 5, dims)
    reward = torch.arange(5, dtype=torch.float64)
    number = torch.tensor([joint(P, dims)[1].index(tuple(a)) for a in action.tolist()])
    rule = {"alpha": alpha, "beta": 1.5, "gamma": gamma}
    y = cvi_target(reward, P, action, P_next, dims=dims, **rule)
    whole = cvi_target(reward, joint(P, dims)[0], number, joint(P_next, dims)[0], **rule)
    torch.testing.assert_close(y, whole, rtol=0, atol=1e-9)
    dqn = dqn_target(reward, P_next, gamma=gamma, dims=dims)
    torch.testing.assert_close(dqn, dqn_target(reward, joint(P_next, dims)[0], gamma=gamma))


@given(seed=st.integers(0, 2**32), actions=st.integers(2, 9))
def test_one_dimension_is_the_same_bit_by_bit(seed: int, actions: int) -> None:
    P, action = drawn(seed, 7, [actions])
    P, single = P.float(), action[:, 0]
    assert torch.equal(mellowmax(P, 2.0, [actions]), mellowmax(P, 2.0))
    assert torch.equal(taken(P, action, [actions]), taken(P, single))
    rule = {"alpha": 0.9, "beta": 2.0, "gamma": 0.9}
    reward = torch.ones(7)
    factored = cvi_target(reward, P, action, P.flip(0), dims=[actions], **rule)
    assert torch.equal(factored, cvi_target(reward, P, single, P.flip(0), **rule))


def test_outputs_of_an_action_stand_behind_those_of_the_dimensions_before() -> None:
    action = torch.tensor([[0, 1, 2], [2, 0, 0]])
    assert outputs_taken(action, [3, 2, 4]).tolist() == [[0, 4, 7], [2, 3, 5]]


@given(st.floats(0.1, 10))
def test_a_floor_holds_bad_actions_and_changes_no_good_one(floor: float) -> None:
    P = torch.tensor([[0.0, -100.0, -floor / 4]], dtype=torch.float64).expand(3, 3)
    gap, floored = cvi_gap(P, torch.tensor([0, 1, 2]), beta=1.0, floor=floor)
    assert floored[0] == gap[0] > 0
    assert floored[1] == pytest.approx(-floor)
    assert gap[1] < -90


@pytest.mark.parametrize("path", available_paths())
@pytest.mark.parametrize("network_of", [binary_network, float_network])
def test_the_kernels_gradients_of_several_dimensions_are_autograds(
    path: str, network_of: Callable[[NetworkSpec, int], PNetwork]
) -> None:
    dims = [3, 2, 4]
    spec = NetworkSpec(channels=2, hidden_units=20, actions=9, action_dims=tuple(dims))
    network, (pixels, _, y) = network_of(spec, 5), data(spec, 5)
    _, action = drawn(7, len(y), dims)
    outputs = outputs_taken(action, dims)
    batch = torch.arange(9)
    native = native_gradients if isinstance(network, BinaryNetwork) else native_float_gradients
    plain = named_gradients(network, autograd_gradients(network, pixels, outputs, y), batch)
    found = named_gradients(network, native(network, pixels, outputs, y, path=path), batch)  # type: ignore[arg-type]
    for name, gradient in plain.items():
        assert distance(found[name], gradient) < 2e-4, name
    P = network(pixels[batch].float().permute(0, 3, 1, 2))
    loss = (y[batch] - taken(P, action[batch], dims)).square().mean() / 2
    assert float(plain["loss"]) == pytest.approx(float(loss.detach()), rel=1e-5)


def of_a_sum(dims: list[int], episodes: int = 12) -> Transitions:
    """One picture, and rewards that are a sum over the dimensions of what each was chosen for."""
    rng = np.random.default_rng(0)
    worth = [np.linspace(-1, 1, n) for n in dims]
    data = []
    for _ in range(episodes):
        actions = np.stack([rng.integers(0, n, 10) for n in dims], axis=1)
        rewards = sum(own[actions[:, d]] for d, own in enumerate(worth))
        data.append(EpisodeData(np.full((11, 1, 84, 84), 90, np.uint8), actions, rewards, False))
    return Transitions.from_episodes(data, frames_stacked=1)


@pytest.mark.parametrize("network_of", [binary_network, float_network])
@pytest.mark.parametrize("target", ["cvi", "dqn"])
def test_an_update_learns_which_choice_is_best_in_each_dimension(
    target: str, network_of: Callable[[NetworkSpec, int], PNetwork]
) -> None:
    dims = [3, 4]
    spec = NetworkSpec(channels=1, hidden_units=32, actions=7, action_dims=tuple(dims))
    network, D = network_of(spec, 3), of_a_sum(dims)
    settings = UpdateConfig(target=target, gamma=0.0, alpha=0.0, epochs=60, relative_targets=True)
    optimizer = make_optimizer(network, 3e-3)
    report = policy_update(network, optimizer, D, settings, np.random.default_rng(0))
    assert report.loss_last < report.loss_first
    P = preferences(network, [D.gather(D.observations[:1])])[0]
    assert [int(part.argmax()) for part in torch.split(P, dims)] == [2, 3]
