"""Algorithm 1's PolicyUpdate: what it computes, that it learns, and that it repeats itself bit by bit."""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.cvi import cvi_target
from bpn_learner.fold import fold
from bpn_learner.networks import SCALE_RATE_FACTOR, BinaryNetwork, FloatNetwork, PNetwork
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import (
    DivergenceError,
    UpdateConfig,
    UpdateReport,
    UpdateStopped,
    annealing,
    make_optimizer,
    minibatches_per_epoch,
    policy_update,
    preferences,
    set_learning_rate,
    target_preferences,
    targets,
)
from bpn_shared.bnn import golden
from bpn_shared.spec.network import NetworkSpec
from bpn_shared.spec.observation import stack
from bpn_shared.spec.sections import Backend

SPEC = NetworkSpec(channels=1, hidden_units=20, actions=3)


def episode(seed: int, steps: int = 10, channels: int = 1, terminated: bool = False) -> EpisodeData:
    rng = np.random.default_rng(seed)
    return EpisodeData(
        frames=rng.integers(0, 256, (steps + 1, channels, 84, 84), np.uint8),
        actions=rng.integers(0, 3, steps).astype(np.uint8),
        rewards=rng.normal(size=steps),
        terminated=terminated,
    )


def binary_network(seed: int = 0) -> BinaryNetwork:
    return BinaryNetwork(SPEC, scale_initial=0.2, generator=torch.Generator().manual_seed(seed))


def transitions(episodes: int = 3) -> Transitions:
    return Transitions.from_episodes([episode(i) for i in range(episodes)], frames_stacked=1)


def update(network: PNetwork, settings: UpdateConfig, seed: int = 0) -> UpdateReport:
    optimizer = make_optimizer(network, 1e-3)
    return policy_update(network, optimizer, transitions(), settings, np.random.default_rng(seed))


@pytest.mark.parametrize("difference", [False, True])
@pytest.mark.parametrize("frames_stacked", [1, 2, 3])
def test_observations_are_the_stacked_frames_of_their_episode(
    frames_stacked: int, difference: bool
) -> None:
    episodes = [episode(0, 4, 2, terminated=True), episode(1, 1, 2), episode(2, 6, 2)]
    data = Transitions.from_episodes(episodes, frames_stacked=frames_stacked, difference=difference)
    seen = partial(stack, frames_stacked=frames_stacked, difference=difference)
    steps = [(e, t) for e in episodes for t in range(len(e.actions))]
    now = [seen(list(e.frames), t) for e, t in steps]
    after = [seen(list(e.frames), t + 1) for e, t in steps]
    assert np.array_equal(data.gather(data.observations).numpy(), np.stack(now))
    assert np.array_equal(data.gather(data.next_observations).numpy(), np.stack(after))
    assert data.done.tolist() == [e.terminated and t == len(e.actions) - 1 for e, t in steps]
    assert data.actions.tolist() == [int(e.actions[t]) for e, t in steps]
    assert data.rewards.tolist() == [float(np.float32(e.rewards[t])) for e, t in steps]
    assert len(data) == len(steps)
    kept = frames_stacked if difference else 1
    assert len(data.frames) == kept * sum(len(e.frames) for e in episodes)


def test_episodes_that_do_not_fit_are_refused() -> None:
    whole = episode(0)
    with pytest.raises(ValueError, match="10 actions and 10 rewards has 10 frames"):
        Transitions.from_episodes([replace(whole, frames=whole.frames[:-1])], frames_stacked=1)
    with pytest.raises(ValueError, match="at least 1 episode"):
        Transitions.from_episodes([], frames_stacked=1)


@given(st.integers(2, 5000), st.integers(2, 256))
def test_an_epoch_has_the_rounded_number_of_minibatches_and_none_of_one(
    size: int, batch: int
) -> None:
    count = minibatches_per_epoch(size, batch)
    assert count == 1 or abs(count - size / batch) <= 0.5
    lengths = [len(range(size)[batch * k : batch * (k + 1)]) for k in range(count)]
    assert min(lengths) >= 2


def test_one_transition_is_too_few() -> None:
    with pytest.raises(ValueError, match="at least 2"):
        minibatches_per_epoch(1, 32)


@pytest.mark.parametrize("mask", [False, True])
def test_targets_are_cvis_of_the_folded_network(mask: bool) -> None:
    network = binary_network()
    data = Transitions.from_episodes([episode(0, terminated=True)], frames_stacked=1)
    settings = UpdateConfig(alpha=0.9, beta=2.0, gamma=0.8, bootstrap_terminals=not mask)
    blob = fold(network)
    P = torch.stack(
        [
            torch.from_numpy(np.float32(blob.scale) * golden.forward(blob, f.numpy())[-1])
            for f in data.frames
        ]
    ).float()
    y, _ = targets(data, *target_preferences(network, data), settings)
    expected = cvi_target(
        data.rewards, P[:-1], data.actions, P[1:], alpha=0.9, beta=2.0, gamma=0.8,
        done=data.done if mask else None,
    )  # fmt: skip
    assert torch.equal(y, expected)


@given(
    st.sampled_from(["cvi", "dqn"]),
    st.booleans(),
    st.floats(-1e3, 1e3),
    st.floats(0, 1),
    st.floats(0.1, 10),
    st.integers(0, 100),
)
def test_relative_targets_are_the_absolute_ones_less_their_mean(
    target: Literal["cvi", "dqn"],
    mask: bool,
    offset: float,
    alpha: float,
    beta: float,
    seed: int,
) -> None:
    """Also when they are computed from relative preferences, so that neither ever sees another policy."""
    D = Transitions.from_episodes(
        [episode(i, terminated=i == 1) for i in range(3)], frames_stacked=1
    )
    generator = torch.Generator().manual_seed(seed)
    P, P_next = torch.randn(2, len(D), 3, generator=generator, dtype=torch.float64)
    absolute = UpdateConfig(target=target, alpha=alpha, beta=beta, bootstrap_terminals=not mask)
    y, none = targets(D, P + offset, P_next + offset, absolute)
    assert none == 0
    relative = replace(absolute, relative_targets=True)
    y_relative, next_offset = targets(D, P, P_next, relative, offset)
    assert torch.allclose(y_relative + next_offset, y, rtol=0, atol=1e-8)
    assert abs(float(y_relative.mean())) < 1e-8


@pytest.mark.parametrize("relative", [False, True])
def test_an_update_leaves_the_mean_of_its_targets_to_the_offset(relative: bool) -> None:
    network = binary_network()
    settings = UpdateConfig(epochs=1, relative_targets=relative, bootstrap_terminals=False)
    for _ in range(2):
        P = target_preferences(network, transitions())
        _, expected = targets(transitions(), *P, settings, float(network.offset))
        update(network, settings)
        assert float(network.offset) == expected
    assert (expected != 0) == relative


def test_an_update_equals_algorithm_1_written_plainly() -> None:
    """One transition at a time from D', targets computed anew by a frozen copy for every minibatch."""
    settings = UpdateConfig(alpha=0.9, beta=2.0, gamma=0.8, epochs=3, batch_size=8, backend="torch")
    network, plain, frozen = (binary_network() for _ in range(3))
    report = update(network, settings)

    data = transitions()
    frozen.eval()
    plain.train()
    optimizer = torch.optim.Adam([plain.latent, plain.gamma, plain.beta], lr=1e-3)
    optimizer.add_param_group({"params": [plain.log_scale], "lr": 3e-3})
    rng = np.random.default_rng(0)
    updates = 0
    for _ in range(3):
        shuffled = rng.permutation(30)
        for k in range(4):  # round(30 / 8)
            batch = shuffled[8 * k : 8 * (k + 1)]
            s = torch.stack([data.frames[data.observations[i, 0]] for i in batch]).float()
            s_next = torch.stack([data.frames[data.next_observations[i, 0]] for i in batch]).float()
            with torch.no_grad():
                y = cvi_target(
                    data.rewards[batch], frozen(s), data.actions[batch], frozen(s_next),
                    alpha=0.9, beta=2.0, gamma=0.8,
                )  # fmt: skip
            error = y - plain(s)[torch.arange(len(batch)), data.actions[batch]]
            optimizer.zero_grad()
            (0.5 * error**2).mean().backward()
            optimizer.step()
            plain.latent.data.clamp_(-1, 1)
            updates += 1
    assert report.updates == updates
    assert torch.allclose(network.latent, plain.latent, atol=1e-5)
    assert report.scale == pytest.approx(float(plain.log_scale.detach().exp()), rel=1e-5)


def test_both_engines_do_the_same_first_update() -> None:
    """Later ones part by rounding: a value near 0 changes its sign, and Adam has no scale."""
    networks = [binary_network() for _ in range(2)]
    fast, plain = (
        update(network, UpdateConfig(epochs=1, batch_size=30, backend=backend))
        for network, backend in zip(networks, ("native", "torch"), strict=True)
    )
    assert fast.updates == plain.updates == 1
    assert fast.loss_last == pytest.approx(plain.loss_last, rel=1e-6)
    assert fast.scale == pytest.approx(plain.scale, rel=1e-6)
    assert (fast.max_target, fast.max_preference) == (plain.max_target, plain.max_preference)
    difference = (networks[0].latent - networks[1].latent).norm() / networks[1].latent.norm()
    assert difference < 1e-4


@pytest.mark.parametrize("backend", ["native", "torch"])
def test_equal_inputs_give_equal_bits(backend: Backend) -> None:
    settings = UpdateConfig(epochs=3, batch_size=8, backend=backend)
    first, second, third = (binary_network() for _ in range(3))
    update(first, settings)
    update(second, settings)
    update(third, settings, seed=1)
    for name, value in first.state_dict().items():
        assert torch.equal(value, second.state_dict()[name]), name
    assert fold(first).content_sha256() == fold(second).content_sha256()
    assert not torch.equal(first.latent, third.latent)


@pytest.mark.parametrize("target", ["cvi", "dqn"])
@pytest.mark.parametrize("binary", [True, False])
def test_training_fits_the_targets(binary: bool, target: Literal["cvi", "dqn"]) -> None:
    network: PNetwork = (
        binary_network()
        if binary
        else FloatNetwork(SPEC, generator=torch.Generator().manual_seed(0))
    )
    report = update(network, UpdateConfig(epochs=40, batch_size=8, target=target))
    assert report.loss_last < 0.5 * report.loss_first
    assert not network.training


def test_the_updated_network_folds_exactly_and_its_latent_weights_are_clipped() -> None:
    network = binary_network()
    update(network, UpdateConfig(epochs=3, batch_size=8))
    assert network.latent.abs().max() <= 1
    blob = fold(network)
    data = transitions()
    P = preferences(network, [data.gather(data.observations)]).numpy()
    frames = data.frames[data.observations[:, 0]].numpy()
    for i, frame in enumerate(frames):
        o = golden.forward(blob, frame)[-1].astype(np.float32)
        assert np.array_equal(P[i], np.float32(blob.scale) * o)


def test_batch_norm_is_estimated_anew_over_d() -> None:
    network = binary_network()
    update(network, UpdateConfig(epochs=3, batch_size=8))
    data = transitions()
    integers = network.integers(data.gather(data.observations).float())[:-1]
    mean = torch.cat([o.double().mean(dim=(0, 2, 3)) for o in integers])
    var = torch.cat([o.double().var(dim=(0, 2, 3), correction=0) for o in integers])
    assert torch.allclose(network.mean, mean)
    assert torch.allclose(network.var, var)


def test_progress_is_told_and_stop_is_asked_every_epoch() -> None:
    seen: list[tuple[int, int]] = []
    network = binary_network()
    with pytest.raises(UpdateStopped, match="after 2 of 5"):
        policy_update(
            network,
            make_optimizer(network, 1e-3),
            transitions(),
            UpdateConfig(epochs=5, batch_size=8),
            np.random.default_rng(0),
            progress=lambda done, total: seen.append((done, total)),
            stop=lambda: len(seen) == 2,
        )
    assert seen == [(1, 5), (2, 5)]


def test_stop_is_asked_within_a_long_epoch(monkeypatch: pytest.MonkeyPatch) -> None:
    network, asked = binary_network(), 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked == 2

    assert minibatches_per_epoch(len(transitions()), 2) > 1
    monkeypatch.setattr("bpn_learner.update._STOP_EVERY", 1)
    with pytest.raises(UpdateStopped, match="after 0 of 1"):
        policy_update(
            network,
            make_optimizer(network, 1e-3),
            transitions(),
            UpdateConfig(epochs=1, batch_size=2),
            np.random.default_rng(0),
            stop=stop,
        )


def test_divergence_is_named() -> None:
    network = binary_network()
    network.log_scale.data.fill_(60.0)
    with pytest.raises(DivergenceError, match="lower the learning rate"):
        update(network, UpdateConfig(epochs=2, batch_size=8))


def test_saturated_targets_are_counted() -> None:
    data = transitions()
    data.rewards.fill_(-1000.0)
    data.rewards[:10] = 0.0
    network = binary_network()
    report = policy_update(
        network,
        make_optimizer(network, 1e-3),
        data,
        UpdateConfig(epochs=1, batch_size=8),
        np.random.default_rng(0),
    )
    assert report.saturation == pytest.approx(20 / 30)
    assert report.max_target > 900


@given(st.integers(2, 60), st.floats(0, 1), st.floats(0.1, 1))
def test_the_rate_falls_along_a_cosine_to_its_final_share(
    epochs: int, final: float, share: float
) -> None:
    settings = UpdateConfig(epochs=epochs, lr_update_final_factor=final, learning_rate_share=share)
    factors = [annealing(epoch, settings) for epoch in range(epochs)]
    assert factors[0] == pytest.approx(share)
    assert factors == sorted(factors, reverse=True)
    assert factors[-1] == pytest.approx(share * final)
    if epochs % 2:
        assert factors[epochs // 2] == pytest.approx(share * (1 + final) / 2)


def test_every_parameter_group_is_annealed_and_the_next_update_starts_anew() -> None:
    optimizer = make_optimizer(binary_network(), 1e-3)
    set_learning_rate(optimizer, 0.5)
    set_learning_rate(optimizer, 0.25)
    assert [group["lr"] for group in optimizer.param_groups] == pytest.approx(
        [0.25e-3, 0.25e-3 * SCALE_RATE_FACTOR]
    )
