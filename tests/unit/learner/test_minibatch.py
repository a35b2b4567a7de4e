"""The kernel's gradients are autograd's: every geometry, every instruction-set path, bit by bit repeatable."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from geometries import geometries, shapes
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from minibatches import (
    TRANSITIONS,
    binary_network,
    data,
    distance,
    exact_gradients,
    float_network,
    margin,
    named_gradients,
)
from torch import Tensor

from bpn_learner.minibatch import (
    Gradients,
    autograd_gradients,
    available_paths,
    minibatch_gradients,
    native_float_gradients,
    native_gradients,
)
from bpn_learner.networks import (
    BinaryNetwork,
    FloatNetwork,
    dot_products,
)
from bpn_learner.update import make_optimizer
from bpn_shared.spec.network import Convolution, NetworkSpec

PATHS = available_paths()
LARGER = (Convolution(8, 4, 32), Convolution(4, 2, 64), Convolution(3, 1, 64))


@pytest.mark.parametrize("path", PATHS)
@settings(max_examples=60, derandomize=True)
@given(
    spec=geometries(range(1, 17), 130, 40) | shapes(),
    B=st.integers(2, TRANSITIONS),
    seed=st.integers(0, 1000),
)
@example(spec=NetworkSpec(channels=6, hidden_units=100, actions=7), B=TRANSITIONS, seed=0)
@example(spec=NetworkSpec(channels=4, hidden_units=64, actions=6, convolutions=LARGER), B=5, seed=3)
@example(spec=NetworkSpec(channels=16, hidden_units=1, actions=64), B=2, seed=1)
@example(spec=NetworkSpec(channels=1, hidden_units=16, actions=2), B=9, seed=2)
def test_gradients_are_autograds(path: str, spec: NetworkSpec, B: int, seed: int) -> None:
    network, (pixels, actions, y) = binary_network(spec, seed), data(spec, seed)
    batch = torch.randperm(TRANSITIONS, generator=torch.Generator().manual_seed(seed))[:B]
    # Closer, and float32's rounding decides which side of the jump a value is on.
    assume(margin(network, pixels[batch]) > 2e-6)
    exact = exact_gradients(network, pixels, actions, y, batch)
    plain = named_gradients(network, autograd_gradients(network, pixels, actions, y), batch)
    native = native_gradients(network, pixels, actions, y, path=path)
    found = named_gradients(network, native, batch)
    assert found.keys() == plain.keys() == exact.keys()
    for name, gradient in exact.items():
        # Two images leave batch norm after fc1 hardly a gradient: rounding is then all that is left of it.
        rounding = distance(plain[name], gradient)
        assert distance(found[name], gradient) < 2e-5 + 4 * rounding, (
            f"{name}, autograd's: {rounding}"
        )


@torch.no_grad()
def float_margin(network: FloatNetwork, pixels: Tensor) -> float:
    """How far the nearest value is from where ReLU bends, relative to its layer's, in float64."""
    x, nearest = pixels.double().permute(0, 3, 1, 2), float("inf")
    for layer, (weights, bias) in zip(network.spec.layers[:-1], network.affine(), strict=False):
        z = dot_products(layer, weights.double(), x, bias.double())
        nearest = min(nearest, float(z.abs().min() / z.abs().max()))
        x = z.relu()
    return nearest


@pytest.mark.parametrize("path", PATHS)
@settings(max_examples=60, derandomize=True)
@given(
    spec=geometries(range(1, 17), 130, 40) | shapes(),
    B=st.integers(1, TRANSITIONS),
    seed=st.integers(0, 1000),
)
@example(spec=NetworkSpec(channels=6, hidden_units=100, actions=7), B=TRANSITIONS, seed=0)
@example(spec=NetworkSpec(channels=16, hidden_units=1, actions=64), B=2, seed=1)
@example(spec=NetworkSpec(channels=1, hidden_units=256, actions=14), B=9, seed=2)
def test_gradients_of_float_networks_are_autograds(
    path: str, spec: NetworkSpec, B: int, seed: int
) -> None:
    network, (pixels, actions, y) = float_network(spec, seed), data(spec, seed)
    batch = torch.randperm(TRANSITIONS, generator=torch.Generator().manual_seed(seed))[:B]
    assume(
        float_margin(network, pixels[batch]) > 1e-7
    )  # else rounding decides the side of the bend
    exact = exact_gradients(network, pixels, actions, y, batch)
    plain = named_gradients(network, autograd_gradients(network, pixels, actions, y), batch)
    native = native_float_gradients(network, pixels, actions, y, path=path)
    found = named_gradients(network, native, batch)
    assert found.keys() == plain.keys() == exact.keys() == {"loss", "weights", "biases"}
    for name, gradient in exact.items():
        rounding = distance(plain[name], gradient)
        assert distance(found[name], gradient) < 1e-5 + 4 * rounding, (
            f"{name}, autograd's: {rounding}"
        )


def test_the_brightest_pixels_overflow_nothing() -> None:
    spec = NetworkSpec(channels=16, hidden_units=5, actions=3)
    pixels = torch.full((2, 84, 84, 16), 255, dtype=torch.uint8)
    pixels[1, ::2] = 0
    actions, y = torch.tensor([0, 2]), torch.tensor([1.0, -1.0])
    for path in PATHS:
        network = binary_network(spec, 0)
        network.latent.data.abs_()
        batch = torch.tensor([0, 1])
        expected = named_gradients(network, autograd_gradients(network, pixels, actions, y), batch)
        native = native_gradients(network, pixels, actions, y, path=path)
        found = named_gradients(network, native, batch)
        assert torch.allclose(found["loss"], expected["loss"], rtol=1e-5), path


def native(
    network: BinaryNetwork | FloatNetwork, pixels: Tensor, actions: Tensor, y: Tensor, path: str
) -> Gradients:
    if isinstance(network, BinaryNetwork):
        return native_gradients(network, pixels, actions, y, path=path)
    return native_float_gradients(network, pixels, actions, y, path=path)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("make", [binary_network, float_network])
def test_equal_inputs_give_equal_bits_wherever_memory_lies(
    path: str, make: Callable[[NetworkSpec, int], BinaryNetwork | FloatNetwork]
) -> None:
    spec = NetworkSpec(channels=3, hidden_units=33, actions=5)
    pixels, actions, y = data(spec, 0)
    batch = torch.arange(TRANSITIONS - 1)
    results = []
    for offset in (0, 1, 4, 60):
        network = make(spec, 0)
        shifted = torch.empty(pixels.numel() + offset, dtype=torch.uint8)[offset:]
        moved = shifted.view(pixels.shape).copy_(pixels)
        gradients = native(network, moved, actions, y, path)
        gradients(torch.arange(2))  # scratch that another minibatch has used
        results.append(named_gradients(network, gradients, batch))
    for result in results[1:]:
        for name, value in result.items():
            assert torch.equal(value, results[0][name]), name


def test_the_kernel_follows_parameters_that_an_optimizer_moves() -> None:
    spec = NetworkSpec(channels=2, hidden_units=20, actions=4)
    pixels, actions, y = data(spec, 3)
    batch = torch.arange(TRANSITIONS)
    network = binary_network(spec, 3)
    native, optimizer = native_gradients(network, pixels, actions, y), make_optimizer(network, 1e-3)
    for _ in range(3):
        native(batch)
        optimizer.step()
        network.clip_latent_weights()
    kept = named_gradients(network, native, batch)
    fresh = named_gradients(network, native_gradients(network, pixels, actions, y), batch)
    for name, value in kept.items():
        assert torch.equal(value, fresh[name]), name


def test_bad_input_is_refused() -> None:
    spec = NetworkSpec(channels=2, hidden_units=20, actions=4)
    pixels, actions, y = data(spec, 0)
    network = binary_network(spec, 0)
    native = native_gradients(network, pixels, actions, y)
    with pytest.raises(IndexError, match="outside D"):
        native(torch.tensor([0, TRANSITIONS]))
    with pytest.raises(IndexError, match="action"):
        native_gradients(network, pixels, actions + 4, y)(torch.tensor([0, 1]))
    with pytest.raises(ValueError, match="at least 1"):
        native(torch.tensor([], dtype=torch.int64))
    with pytest.raises(ValueError, match=r"uint8\[n, 84, 84, 2\]"):
        native_gradients(network, pixels[..., :1].contiguous(), actions, y)(torch.tensor([0, 1]))
    with pytest.raises(ValueError, match="lengths"):
        native_gradients(network, pixels, actions[:3], y)(torch.tensor([0, 1]))
    with pytest.raises(ValueError, match="cannot run the path mmx"):
        native_gradients(network, pixels, actions, y, path="mmx")


def test_bad_input_for_float_networks_is_refused() -> None:
    spec = NetworkSpec(channels=2, hidden_units=20, actions=4)
    pixels, actions, y = data(spec, 0)
    network = float_network(spec, 0)
    with pytest.raises(IndexError, match="outside D"):
        native_float_gradients(network, pixels, actions, y)(torch.tensor([0, TRANSITIONS]))
    other = float_network(NetworkSpec(channels=2, hidden_units=21, actions=4), 0)
    other.spec = spec
    with pytest.raises(ValueError, match="not the network's sizes"):
        native_float_gradients(other, pixels, actions, y)(torch.tensor([0, 1]))


@pytest.mark.parametrize("make", [binary_network, float_network])
def test_fast_is_the_kernel_and_plain_is_autograd(
    make: Callable[[NetworkSpec, int], BinaryNetwork | FloatNetwork],
) -> None:
    spec = NetworkSpec(channels=1, hidden_units=6, actions=3)
    pixels, actions, y = data(spec, 0)
    observations = pixels.permute(0, 3, 1, 2)
    network, batch = make(spec, 0), torch.arange(4)
    fast = minibatch_gradients("native", network, observations, actions, y)(batch)
    plain = minibatch_gradients("torch", network, observations, actions, y)(batch)
    assert isinstance(fast, float)
    assert isinstance(plain, Tensor)
    assert fast == pytest.approx(float(plain), rel=1e-5)


@pytest.mark.parametrize("make", [binary_network, float_network])
@settings(max_examples=15, derandomize=True, deadline=None)
@given(spec=geometries(range(1, 17), 40, 20) | shapes(), seed=st.integers(0, 1000))
def test_black_pictures_and_parts_of_them_change_no_gradient(
    make: Callable[[NetworkSpec, int], BinaryNetwork | FloatNetwork],
    spec: NetworkSpec,
    seed: int,
) -> None:
    pixels, actions, y = data(spec, seed)
    rng = np.random.default_rng(seed)
    for picture in pixels:
        top, left = rng.integers(0, spec.image_px, 2)
        height, width = rng.integers(0, spec.image_px, 2)  # 0: all of it is black
        kept = picture[top : top + height, left : left + width].clone()
        picture.zero_()
        picture[top : top + height, left : left + width] = kept
    network, batch = make(spec, seed), torch.arange(TRANSITIONS)
    plain = named_gradients(network, autograd_gradients(network, pixels, actions, y), batch)
    exact = exact_gradients(network, pixels, actions, y, batch)
    near = margin if isinstance(network, BinaryNetwork) else float_margin
    assume(near(network, pixels[batch]) > 2e-6)  # type: ignore[arg-type]
    for path in PATHS:
        found = named_gradients(network, native(network, pixels, actions, y, path), batch)
        for name, gradient in exact.items():
            rounding = distance(plain[name], gradient)
            assert distance(found[name], gradient) < 2e-5 + 4 * rounding, (path, name)


@settings(max_examples=20, derandomize=True)
@given(spec=geometries(range(1, 17), 130, 40) | shapes(), seed=st.integers(0, 1000))
def test_ways_to_count_bits_give_one_result(spec: NetworkSpec, seed: int) -> None:
    pixels, actions, y = data(spec, seed)
    network, batch = binary_network(spec, seed), torch.arange(TRANSITIONS)
    avx512 = [path for path in PATHS if path in {"avx512-vnni", "cascade-lake"}]
    found = [
        named_gradients(network, native_gradients(network, pixels, actions, y, path=path), batch)
        for path in (avx512 or PATHS[:1])
    ]
    for name, gradient in found[0].items():
        assert all(torch.equal(gradient, other[name]) for other in found), name
