"""That configuration and settings reach what they are for: parts are tested elsewhere, here their calls."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from bpn_learner.gathering import RegressionBatch
from bpn_learner.networks import BinaryNetwork
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import (
    EVALUATION_BATCH,
    UpdateConfig,
    fit,
    make_optimizer,
    policy_update,
    preferences,
)
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(channels=1, hidden_units=12, actions=3)

NO_DEFAULT = RunConfig.bare(
    "tracking", algorithm="bqn", seed=3, iterations=11, episodes=7, steps=9, epochs=4, batch_size=6,
    replay_iterations=5, alpha=0.4, beta=2.5, gamma=0.7, bootstrap_terminals=False, relative_targets=True,
    epsilon_initial=0.9, epsilon_final=0.2, hidden_units=12, learning_rate=0.02, lr_update_final_factor=0.3,
    lr_run_final_factor=0.5, scale_initial=0.4, reward_scale=0.3, backend="torch", n_step=3, gap_floor=6.0,
    max_updates=70, beta_run_final_factor=3.0,
)  # fmt: skip


def network(seed: int = 0) -> BinaryNetwork:
    return BinaryNetwork(SPEC, scale_initial=0.2, generator=torch.Generator().manual_seed(seed))


def transitions(steps: int, *, terminated: bool = False) -> Transitions:
    rng = np.random.default_rng(1)
    episode = EpisodeData(
        frames=rng.integers(0, 256, (steps + 1, 1, 84, 84), np.uint8),
        actions=rng.integers(0, 3, steps),
        rewards=rng.normal(size=steps),
        terminated=terminated,
    )
    return Transitions.from_episodes([episode], frames_stacked=1)


def regression(steps: int) -> RegressionBatch:
    data = transitions(steps)
    return RegressionBatch(data.frames, data.observations, data.actions, data.rewards)


def test_the_configuration_reaches_the_update_in_every_field() -> None:
    assert UpdateConfig.of_iteration(NO_DEFAULT, 4) == UpdateConfig(
        alpha=0.4,
        beta=4.5,  # 2.5, 3 times that in the 11th
        gamma=0.7,
        epochs=4,
        batch_size=6,
        target="dqn",
        bootstrap_terminals=False,
        relative_targets=True,
        n_step=3,
        gap_floor=6.0,
        max_updates=70,
        learning_rate_share=pytest.approx(0.8),
        lr_update_final_factor=0.3,
        backend="torch",
    )
    assert UpdateConfig.of_iteration(NO_DEFAULT, 0).learning_rate_share == 1
    assert UpdateConfig.of_iteration(NO_DEFAULT, 10).learning_rate_share == pytest.approx(0.5)
    assert UpdateConfig.of_iteration(RunConfig.bare("reaching"), 0).target == "cvi"
    given = NO_DEFAULT.model_dump(include={*UpdateConfig.__slots__})
    defaults = RunConfig.bare("reaching").model_dump(include={*UpdateConfig.__slots__})
    assert all(given[name] != defaults[name] for name in given)  # or the test would show nothing


def test_fit_anneals_and_clips_as_a_plain_loop_does() -> None:
    """At a rate so high that latent weights leave [-1, 1] unless they are clipped."""
    settings = UpdateConfig(
        epochs=3, batch_size=8, learning_rate_share=0.5, lr_update_final_factor=0.1, backend="torch"
    )
    data, found, plain = regression(30), network(), network()
    losses = fit(found, make_optimizer(found, 1.0), data, settings, np.random.default_rng(5))

    adam = torch.optim.Adam([plain.latent, plain.gamma, plain.beta], fused=True)
    adam.add_param_group({"params": [plain.log_scale]})
    plain.train()
    rng = np.random.default_rng(5)
    expected, clipped = [], 0
    for share in (1.0, 0.55, 0.1):  # of half the rate: a cosine from 1 to 0.1
        for group, rate in zip(adam.param_groups, (1.0, 3.0), strict=True):
            group["lr"] = 0.5 * share * rate
        order, total = rng.permutation(30), 0.0
        for k in range(4):  # round(30 / 8)
            rows = order[8 * k : 8 * (k + 1)]
            pixels = data.frames[data.observations[rows, 0]].contiguous(
                memory_format=torch.channels_last
            )
            taken = plain(pixels.float())[torch.arange(len(rows)), data.actions[rows]]
            loss = (data.y[rows] - taken).square().sum() / (2 * len(rows))
            adam.zero_grad()
            loss.backward()
            adam.step()
            clipped += int((plain.latent.detach().abs() > 1).sum())
            plain.latent.data.clamp_(-1, 1)
            total += float(loss.detach())
        expected.append(total / 4)
    assert clipped > 0  # or the test would show nothing
    assert losses == pytest.approx(expected, rel=1e-4)
    for name in ("latent", "gamma", "beta", "log_scale"):
        assert torch.allclose(getattr(found, name), getattr(plain, name), atol=1e-4), name
    assert float(found.latent.detach().abs().max()) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"lr_update_final_factor": 1.0},
        {"learning_rate_share": 1.0},
        {"epochs": 4},
        {"batch_size": 7},
    ],
)
def test_every_setting_of_fit_changes_what_it_does(changes: dict[str, float]) -> None:
    settings = UpdateConfig(
        epochs=3, batch_size=8, learning_rate_share=0.5, lr_update_final_factor=0.1, backend="torch"
    )
    first, second = network(), network()
    for one, asked in ((first, settings), (second, replace(settings, **changes))):
        fit(one, make_optimizer(one, 1e-3), regression(30), asked, np.random.default_rng(0))
    assert not torch.equal(first.latent, second.latent)


def test_batch_norm_is_estimated_over_all_of_d_and_not_its_first_part() -> None:
    data = transitions(EVALUATION_BATCH + 40)
    data.frames[EVALUATION_BATCH:] //= 4  # another picture: the first part does not stand for all
    found = network()
    settings = UpdateConfig(epochs=1, batch_size=64)
    policy_update(found, make_optimizer(found, 1e-3), data, settings, np.random.default_rng(0))
    sums = found.integers(data.gather(data.observations).float())[:-1]
    mean = torch.cat([o.double().mean(dim=(0, 2, 3)) for o in sums])
    part = torch.cat([o[:EVALUATION_BATCH].double().mean(dim=(0, 2, 3)) for o in sums])
    assert torch.allclose(found.mean, mean)
    assert not torch.allclose(found.mean, part)


@pytest.mark.parametrize(
    "changes",
    [{"alpha": 0.1}, {"beta": 9.0}, {"gamma": 0.1}, {"bootstrap_terminals": False},
     {"target": "dqn"}, {"relative_targets": True}],
)  # fmt: skip
def test_every_setting_of_the_targets_changes_what_is_fitted(changes: dict[str, object]) -> None:
    data = transitions(30, terminated=True)
    data.rewards[-1] = 50.0  # the terminal transition's target is the largest
    settings = UpdateConfig(alpha=0.6, beta=2.0, gamma=0.8, epochs=1, batch_size=8)
    reports = []
    for asked in (settings, replace(settings, **changes)):  # type: ignore[arg-type]
        one = network()
        optimizer = make_optimizer(one, 1e-3)
        reports.append(policy_update(one, optimizer, data, asked, np.random.default_rng(0)))
    assert reports[0].max_target != reports[1].max_target


def test_the_network_is_left_as_it_is_released() -> None:
    found, data = network(), transitions(20)
    settings = UpdateConfig(epochs=1, batch_size=8)
    policy_update(found, make_optimizer(found, 1e-3), data, settings, np.random.default_rng(0))
    assert not found.training
    seen = data.gather(data.observations)
    assert torch.equal(
        preferences(found, seen.split(EVALUATION_BATCH)),
        torch.cat([found(s[None].float()) for s in seen]),
    )
