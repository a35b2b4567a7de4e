"""The folded integer network equals the evaluated torch network, and golden equals float64 torch."""

import numpy as np
import pytest
import torch
from geometries import geometries, shapes
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_learner.fold import fold, smallest_positive
from bpn_learner.networks import BinaryNetwork, activation
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.spec.network import NetworkSpec

GAMMAS = [0.0, -0.0, 1e-38, -1e-38, 1e-6, -1e-3, 1.0, -1.0, 7.5, -300.0, 1e30, -1e30]
VARIANCES = [0.0, 1e-12, 1e-5, 0.25, 1.0, 63.0, 1e4, 1e12]


@st.composite
def networks(draw: st.DrawFn) -> BinaryNetwork:
    spec = draw(geometries([1, 3], 24, 8) | shapes(hidden_units=24))
    seed = draw(st.integers(0, 2**32))
    rng = np.random.default_rng(seed)
    network = BinaryNetwork(
        spec, scale_initial=0.3, generator=torch.Generator().manual_seed(seed)
    ).eval()
    channels = len(network.gamma)
    network.gamma.data = torch.from_numpy(
        np.where(
            rng.random(channels) < 0.5, rng.normal(size=channels), rng.choice(GAMMAS, channels)
        )
    ).float()
    # beta = 0 with an integer mean puts o = mean exactly on the tie a o + b = 0.
    network.beta.data = torch.from_numpy(
        np.where(rng.random(channels) < 0.5, 0.0, rng.normal(scale=2, size=channels))
    ).float()
    spread = np.concatenate(
        [np.full(g.out_channels, np.sqrt(g.fan_in) * g.max_input) for g in spec.layers[:-1]]
    )
    mean = rng.normal(size=channels) * spread
    network.mean.copy_(torch.from_numpy(np.where(rng.random(channels) < 0.5, np.rint(mean), mean)))
    network.var.copy_(
        torch.from_numpy(
            np.where(rng.random(channels) < 0.7, spread**2, rng.choice(VARIANCES, channels))
        )
    )
    return network


def observations(spec: NetworkSpec, seed: int) -> torch.Tensor:
    """Noise, few levels, all black, all white."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randint(256, (2, *spec.observation_shape), generator=generator)
    noise[1] = noise[1] // 128 * 255
    flat = torch.stack([torch.zeros_like(noise[0]), torch.full_like(noise[0], 255)])
    return torch.cat([noise, flat]).to(torch.uint8)


@settings(max_examples=200)
@given(networks(), st.integers(0, 2**32))
def test_the_folded_network_is_the_evaluated_network(network: BinaryNetwork, seed: int) -> None:
    blob = fold(network)
    frames = observations(network.spec, seed)
    outputs = network.integers(frames.float())
    affine = network.affine()
    for i, frame in enumerate(frames):
        folded = golden.forward(blob, frame.numpy())
        for layer, (a, b) in enumerate(affine):
            on = activation(a, b, outputs[layer])[i].permute(1, 2, 0).numpy() > 0
            folded_on = folded[layer] >= blob.thresholds[layer]
            assert np.array_equal(on, folded_on.reshape(on.shape)), f"layer {layer + 1}"
        assert np.array_equal(outputs[-1][i].flatten().numpy(), folded[-1])
    P = network(frames.float()).detach().numpy()
    assert np.array_equal(P[-1], np.float32(blob.scale) * folded[-1].astype(np.float32))


@given(
    st.floats(0, 1e40),
    st.one_of(st.floats(-1e6, 1e6), st.floats(-1e40, 1e40)),
    st.integers(1, 300),
)
def test_thresholds_are_the_smallest_integer_that_is_on(a: float, b: float, limit: int) -> None:
    (threshold,) = smallest_positive(np.array([a]), np.array([b]), limit)
    on = [o for o in range(-limit, limit + 1) if a * o + b >= 0]
    assert threshold == (on[0] if on else limit + 1)


@given(st.integers(-300, 300), st.floats(1e-6, 1e6))
def test_a_tie_is_on(tie: int, a: float) -> None:
    (threshold,) = smallest_positive(np.array([a]), np.array([-a * tie]), 300)
    assert threshold == tie


def test_provenance_and_lambda_go_into_the_blob() -> None:
    spec = NetworkSpec(1, 4, 3)
    network = BinaryNetwork(spec, scale_initial=0.25, generator=torch.Generator().manual_seed(0))
    blob = fold(network, attempt=2, version=7)
    assert (blob.attempt, blob.version) == (2, 7)
    assert (fold(network).attempt, fold(network).version) == (0, 0)
    assert blob.scale == pytest.approx(0.25)
    assert WeightBlob.decode(blob.encode()).content_sha256() == blob.content_sha256()
    network.log_scale.data.fill_(float("nan"))
    with pytest.raises(BlobError, match="lambda"):
        fold(network)


def torch_forward(blob: WeightBlob, observation: np.ndarray) -> list[np.ndarray]:
    """The blob evaluated by torch in float64: convolutions, then matrix products."""
    x = torch.from_numpy(observation).double()[None]
    outputs: list[np.ndarray] = []
    for index, (layer, signs) in enumerate(zip(blob.spec.layers, blob.weights, strict=True)):
        weights = torch.from_numpy(signs).double()
        if index < 3:
            k = layer.kernel
            kernel = weights.reshape(-1, k, k, layer.in_channels).permute(0, 3, 1, 2)
            o = torch.nn.functional.conv2d(x, kernel.contiguous(), stride=layer.stride)
            outputs.append(o[0].permute(1, 2, 0).numpy())
        else:
            flat = x[0].permute(1, 2, 0).flatten() if x.dim() == 4 else x
            o = torch.nn.functional.linear(flat, weights)
            outputs.append(o.numpy())
        if index < 4:
            tau = torch.from_numpy(blob.thresholds[index]).double()
            x = torch.where(o >= (tau[:, None, None] if index < 3 else tau), 1.0, -1.0).double()
    return outputs


@settings(max_examples=1000)
@given(
    channels=st.sampled_from([1, 3, 6]),
    hidden_units=st.integers(1, 256),
    actions=st.integers(2, 64),
    seed=st.integers(0, 2**32),
    image=st.sampled_from(["noise", "black", "white"]),
)
def test_golden_is_torch_in_float64(
    channels: int, hidden_units: int, actions: int, seed: int, image: str
) -> None:
    rng = np.random.default_rng(seed)
    blob = WeightBlob.random(NetworkSpec(channels, hidden_units, actions), rng)
    observation = {
        "noise": rng.integers(0, 256, blob.spec.observation_shape, np.uint8),
        "black": np.zeros(blob.spec.observation_shape, np.uint8),
        "white": np.full(blob.spec.observation_shape, 255, np.uint8),
    }[image]
    for layer, tau in zip(blob.spec.layers, blob.thresholds, strict=False):
        kind = rng.integers(0, 6, len(tau))
        saturated = [layer.max_output + 1, -layer.max_output]
        tau[:] = np.select([kind == 0, kind == 1], saturated, tau)
    tied = rng.integers(4)  # every channel of one layer reaches its threshold exactly
    reached = golden.forward(blob, observation)[tied].reshape(-1, len(blob.thresholds[tied]))
    blob.thresholds[tied][:] = reached[rng.integers(len(reached))]
    for ours, torchs in zip(
        golden.forward(blob, observation), torch_forward(blob, observation), strict=True
    ):
        assert np.array_equal(ours, torchs)
