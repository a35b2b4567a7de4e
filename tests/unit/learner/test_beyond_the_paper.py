"""Options that go beyond Algorithm 1, in a policy update: n steps, a floor of the gap, at most so many steps."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from bpn.verify.play import Policy
from bpn.verify.targets import Played
from bpn.verify.targets import targets as verified_targets
from bpn.verify.training import learning_rate_factors
from bpn_learner.networks import BinaryNetwork
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import (
    UpdateConfig,
    annealed,
    annealing,
    make_optimizer,
    policy_update,
    targets,
    updates_of,
)
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.joint_actions import format_dims
from bpn_shared.spec.network import NetworkSpec

ACTIONS = 4
lengths_of = st.lists(st.integers(1, 6), min_size=1, max_size=4)
algorithms = st.sampled_from(["bpn", "bqn"])


class Known:
    """A policy whose preferences are given, by the first pixel of what is seen."""

    def __init__(self, table: torch.Tensor) -> None:
        self._table = table

    def preferences(self, seen: torch.Tensor) -> torch.Tensor:
        return self._table[seen[:, 0, 0, 0].long()]


def episodes(
    seed: int, lengths: list[int], dims: tuple[int, ...] = (ACTIONS,)
) -> list[EpisodeData]:
    rng = np.random.default_rng(seed)
    found, first = [], 0
    for index, length in enumerate(lengths):
        frames = np.zeros((length + 1, 1, 1, 1), np.uint8)
        frames[:, 0, 0, 0] = first + np.arange(length + 1)
        first += length + 1
        rewards = rng.normal(-1, 1, length)
        actions = np.stack([rng.integers(0, n, length) for n in dims], axis=1)
        chosen = actions if len(dims) > 1 else actions[:, 0]
        found.append(EpisodeData(frames, chosen, rewards, index % 2 == 0))
    return found


def told(
    seed: int, data: list[EpisodeData], outputs: int = ACTIONS
) -> tuple[Transitions, torch.Tensor, torch.Tensor]:
    """D, P-(s, .) and P-(s', .), float32[n, |A|]."""
    count = sum(len(episode.frames) for episode in data)
    table = 3 * torch.randn(count, outputs, generator=torch.Generator().manual_seed(seed))
    D = Transitions.from_episodes(data, frames_stacked=1)
    return D, table, table


@given(
    seed=st.integers(0, 2**32),
    lengths=lengths_of,
    algorithm=algorithms,
    n=st.integers(1, 7),
    floor=st.sampled_from([0.0, 0.7, 5.0]),
    relative=st.booleans(),
    mask=st.booleans(),
    offset=st.floats(-30, 30),
    dims=st.sampled_from([(ACTIONS,), (2, 3), (3, 2, 4)]),
    iteration=st.integers(0, 49),
)
def test_targets_are_those_that_bpn_verify_computes(
    seed: int, lengths: list[int], algorithm: str, n: int, floor: float, relative: bool, mask: bool, offset: float,
    dims: tuple[int, ...], iteration: int,
) -> None:  # fmt: skip
    config = RunConfig.bare(
        "gym:Some-v0", algorithm=algorithm, beta_run_final_factor=4, n_step=n, gap_floor=floor,
        relative_targets=relative, bootstrap_terminals=not mask, reward_scale=1.0, actions=sum(dims),
        action_dims=format_dims(dims if len(dims) > 1 else ()),
    )  # fmt: skip
    offset = offset if relative else 0.0
    data = episodes(seed, lengths, dims)
    D, table, _ = told(seed, data, sum(dims))
    P, P_next = (
        table[D.frames[which[:, 0], 0, 0, 0].long()]
        for which in (D.observations, D.next_observations)
    )
    settings = UpdateConfig.of_iteration(config, iteration)
    y, c = targets(D, P, P_next, settings, offset, dims=dims)
    played = [
        Played(
            torch.from_numpy(e.frames), torch.from_numpy(e.actions.reshape(len(e.rewards), -1)),
            torch.from_numpy(e.rewards), e.terminated,
        )
        for e in data
    ]  # fmt: skip
    verified = verified_targets(
        config, iteration, played, cast(Policy, Known(table)), offset=offset, reward_scale=1.0
    )
    torch.testing.assert_close(y, verified.y, rtol=1e-5, atol=1e-4)
    assert c == pytest.approx(verified.offset, abs=1e-3)


@given(
    seed=st.integers(0, 2**32),
    lengths=lengths_of,
    algorithm=st.sampled_from(["cvi", "dqn"]),
    n=st.integers(2, 7),
    offset=st.floats(-30, 30),
)
def test_relative_targets_over_n_steps_leave_out_a_constant_alone(
    seed: int, lengths: list[int], algorithm: str, n: int, offset: float
) -> None:
    """Beside ends that are worth 0: P- that lacks c gives what P- with c gives, less the new constant."""
    data = episodes(seed, lengths)
    D, table, _ = told(seed, data)
    P, P_next = (
        table[D.frames[which[:, 0], 0, 0, 0].long()]
        for which in (D.observations, D.next_observations)
    )
    settings = UpdateConfig(
        target=algorithm, n_step=n, bootstrap_terminals=False, relative_targets=True
    )
    y, c = targets(D, P, P_next, settings, offset)
    absolute, none = targets(
        D, P + offset, P_next + offset, replace(settings, relative_targets=False)
    )
    assert none == 0
    torch.testing.assert_close(y + c, absolute, rtol=0, atol=2e-3)


@given(count=st.integers(2, 60), lasting=st.integers(1, 400), epochs=st.integers(1, 6))
def test_no_more_steps_than_asked_for_and_the_rate_falls_to_its_end(
    count: int, lasting: int, epochs: int
) -> None:
    whole = UpdateConfig(epochs=epochs, batch_size=8, lr_update_final_factor=0.1)
    settings = replace(whole, max_updates=lasting)
    assert updates_of(settings, count) == min(updates_of(whole, count), lasting)
    steps = updates_of(settings, count)
    if steps > 1:
        assert annealed(0, steps, settings) == 1
        assert annealed(steps - 1, steps, settings) == pytest.approx(0.1)
    assert annealing(0, whole) == 1


def test_an_update_ends_within_an_epoch() -> None:
    spec = NetworkSpec(channels=1, hidden_units=8, actions=ACTIONS)
    rng = np.random.default_rng(0)
    data = [
        EpisodeData(
            rng.integers(0, 256, (11, 1, 84, 84), np.uint8), rng.integers(0, 4, 10), rng.normal(size=10), False
        )
        for _ in range(3)
    ]  # fmt: skip
    D = Transitions.from_episodes(data, frames_stacked=1)
    reports = []
    for limit in (0, 7):
        network = BinaryNetwork(spec, scale_initial=0.2, generator=torch.Generator().manual_seed(0))
        settings = UpdateConfig(epochs=2, batch_size=5, max_updates=limit)
        told_of: list[tuple[int, int]] = []
        report = policy_update(
            network, make_optimizer(network, 1e-3), D, settings, np.random.default_rng(1),
            progress=lambda done, of, told_of=told_of: told_of.append((done, of)),
        )  # fmt: skip
        reports.append(report)
        assert told_of == [(1, 2), (2, 2)]
        assert 0 <= report.agreement <= 1
        assert 0 <= report.entropy <= np.log(ACTIONS) + 1e-9
    assert [report.updates for report in reports] == [12, 7]


def test_bpn_verify_has_the_same_rates() -> None:
    config = RunConfig.bare(
        "reaching", batch_size=8, epochs=3, max_updates=10, lr_update_final_factor=0.1
    )
    settings = UpdateConfig.of_iteration(config, 4)
    rates = learning_rate_factors(config, 4, 40)
    assert [len(of_epoch) for of_epoch in rates] == [5, 5]
    flat = [rate for of_epoch in rates for rate in of_epoch]
    assert flat == pytest.approx([annealed(k, 10, settings) for k in range(10)])
