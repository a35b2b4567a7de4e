"""Sign and its gradient, exactness of the integers, batch norm re-estimation, and the float network."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from bpn_learner.batch_norm import BATCH_NORM_EPSILON
from bpn_learner.binarize import sign
from bpn_learner.calibrate import reestimate_batch_norm
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(channels=2, hidden_units=12, actions=5)


def binary_network(seed: int = 0, spec: NetworkSpec = SPEC) -> BinaryNetwork:
    return BinaryNetwork(spec, scale_initial=0.2, generator=torch.Generator().manual_seed(seed))


def images(count: int, seed: int = 0, spec: NetworkSpec = SPEC) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    shape = (count, *spec.observation_shape)
    return torch.randint(256, shape, dtype=torch.uint8, generator=generator)


@given(st.lists(st.floats(-3, 3, width=32), min_size=1))
def test_sign_and_its_straight_through_gradient(values: list[float]) -> None:
    x = torch.tensor(values, requires_grad=True)
    incoming = torch.arange(1.0, len(values) + 1)
    y = sign(x)
    (gradient,) = torch.autograd.grad(y, x, incoming)
    assert y.tolist() == [1.0 if v >= 0 else -1.0 for v in values]
    expected = [g if abs(v) <= 1 else 0.0 for v, g in zip(values, incoming.tolist(), strict=True)]
    assert gradient.tolist() == expected


def test_sign_at_its_edges() -> None:
    above = float(np.nextafter(np.float32(1), np.float32(2)))
    x = torch.tensor([0.0, -0.0, 1.0, -1.0, above, -above], requires_grad=True)
    y = sign(x)
    (gradient,) = torch.autograd.grad(y.sum(), x)
    assert y.tolist() == [1, 1, 1, -1, 1, -1]
    assert gradient.tolist() == [1, 1, 1, 1, 0, 0]


def reference_training_pass(network: BinaryNetwork, pixels: torch.Tensor) -> torch.Tensor:
    """The training forward pass in float64 by torch's own layers."""
    x = pixels.double()
    offset = 0
    channels = 0
    for index, layer in enumerate(network.spec.layers):
        size = layer.out_channels * layer.fan_in
        latent = network.latent.detach()[offset : offset + size].double()
        offset += size
        kernel = latent.reshape(layer.out_channels, layer.kernel, layer.kernel, layer.in_channels)
        signs = torch.where(kernel >= 0, 1.0, -1.0).double().permute(0, 3, 1, 2).contiguous()
        x = nn.functional.conv2d(x, signs, stride=layer.stride)
        if index < 4:
            norm = nn.BatchNorm2d(layer.out_channels, eps=BATCH_NORM_EPSILON).double()
            part = slice(channels, channels + layer.out_channels)
            channels += layer.out_channels
            norm.weight.data.copy_(network.gamma.detach()[part])
            norm.bias.data.copy_(network.beta.detach()[part])
            x = torch.where(norm(x) >= 0, 1.0, -1.0).double()
    return x.flatten(1) * network.log_scale.detach().double().exp()


@pytest.mark.parametrize("seed", range(5))
def test_the_training_pass_is_torchs_layers(seed: int) -> None:
    network = binary_network(seed).train()
    generator = torch.Generator().manual_seed(seed)
    network.gamma.data.normal_(generator=generator)
    network.beta.data.normal_(generator=generator)
    pixels = images(8, seed).float()
    P = network(pixels).detach().double()
    assert torch.allclose(P, reference_training_pass(network, pixels), rtol=1e-6, atol=0)


def test_integers_are_exact_at_the_largest_sums() -> None:
    spec = NetworkSpec(channels=16, hidden_units=4, actions=2)
    network = binary_network(0, spec).eval()
    network.latent.data.fill_(1.0)
    white = torch.full((1, *spec.observation_shape), 255.0)
    (o, *_) = network.integers(white)
    assert set(o.flatten().tolist()) == {255 * 64 * 16}


def test_every_parameter_is_trained_and_latent_weights_are_clipped() -> None:
    network = binary_network().train()
    network(images(4).float()).square().sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name
    network.latent.data.mul_(100)
    network.clip_latent_weights()
    assert network.latent.abs().max() == 1


def test_the_generator_alone_decides_the_initial_weights() -> None:
    assert torch.equal(binary_network(3).latent, binary_network(3).latent)
    assert not torch.equal(binary_network(3).latent, binary_network(4).latent)


@settings(max_examples=30)
@given(st.integers(1, 7), st.integers(0, 100))
def test_reestimation_does_not_depend_on_batches_or_order(batch: int, seed: int) -> None:
    observations = images(6, seed)
    reference, network = binary_network(seed), binary_network(seed)
    reestimate_batch_norm(reference, observations.split(6))
    order = torch.randperm(6, generator=torch.Generator().manual_seed(seed))
    reestimate_batch_norm(network, observations[order].split(batch))
    assert torch.equal(network.mean, reference.mean)
    assert torch.equal(network.var, reference.var)


def test_reestimated_statistics_are_those_of_the_evaluated_integers() -> None:
    network = binary_network().eval()
    generator = torch.Generator().manual_seed(1)
    network.gamma.data.normal_(generator=generator)
    network.beta.data.normal_(generator=generator)
    observations = images(30)
    reestimate_batch_norm(network, observations.split(7))
    outputs = [o.double() for o in network.integers(observations.float())[:-1]]
    mean = torch.cat([o.mean(dim=(0, 2, 3)) for o in outputs])
    var = torch.cat([o.var(dim=(0, 2, 3), correction=0) for o in outputs])
    assert torch.allclose(network.mean, mean, rtol=1e-12, atol=1e-9)
    assert torch.allclose(network.var, var, rtol=1e-9, atol=1e-6)


def test_reestimation_needs_an_observation() -> None:
    with pytest.raises(ValueError, match="at least 1 observation"):
        reestimate_batch_norm(binary_network(), [images(0)])


def test_the_float_network_has_the_geometry_and_no_limit() -> None:
    network: PNetwork = FloatNetwork(SPEC, generator=torch.Generator().manual_seed(0))
    assert network(images(3).float()).shape == (3, SPEC.actions)
    assert sum(p.numel() for p in network.parameters()) == SPEC.weight_bits + sum(
        layer.out_channels for layer in SPEC.layers
    )
    assert network.max_preference() == float("inf")


def test_the_float_network_is_torchs_layers() -> None:
    network = FloatNetwork(SPEC, generator=torch.Generator().manual_seed(0))
    parts: list[nn.Module] = []
    for layer, (weights, bias) in zip(SPEC.layers, network.affine(), strict=True):
        part = nn.Conv2d(layer.in_channels, layer.out_channels, layer.kernel, layer.stride)
        shape = (layer.out_channels, layer.kernel, layer.kernel, layer.in_channels)
        part.weight.data = weights.detach().reshape(shape).permute(0, 3, 1, 2).contiguous()
        part.bias.data = bias.detach()
        parts += [part, nn.ReLU()]
    pixels = images(5).float()
    P = network(pixels)
    assert torch.allclose(P, nn.Sequential(*parts[:-1])(pixels).flatten(1), rtol=1e-4, atol=1e-6)
    conv1 = network.affine()[0][0].detach()
    assert conv1.abs().max() * 255 == pytest.approx(SPEC.layers[0].fan_in ** -0.5, rel=0.05)
    P.square().sum().backward()
    assert all(p.grad is not None and p.grad.any() for p in network.parameters())


def test_the_largest_preference_is_lambda_n() -> None:
    assert binary_network().max_preference() == pytest.approx(0.2 * SPEC.hidden_units)
