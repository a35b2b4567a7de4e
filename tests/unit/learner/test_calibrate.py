"""Batch norm statistics over D: exact, however D is cut up."""

from fractions import Fraction

import numpy as np
import pytest
import torch
from geometries import geometries, shapes
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.calibrate import _moments, reestimate_batch_norm
from bpn_learner.networks import BinaryNetwork
from bpn_shared.spec.network import NetworkSpec

LARGEST = 6 * 64 * 255
"""Of a sum of pixels in the paper's network: its square is beyond float32, their sum beyond int32."""


@given(
    sizes=st.lists(st.integers(1, 5), min_size=1, max_size=3),
    channels=st.integers(1, 3),
    seed=st.integers(0, 2**32),
)
def test_moments_are_those_of_exact_arithmetic(sizes: list[int], channels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shift = rng.integers(-LARGEST, LARGEST, (channels, 1, 1))
    parts = [rng.integers(0, 9, (size, channels, 3, 2)) + shift for size in sizes]
    mean, var = _moments([torch.from_numpy(part).float() for part in parts])
    assert mean.dtype == var.dtype == torch.float64
    for channel in range(channels):
        values = [int(v) for part in parts for v in part[:, channel].ravel()]
        exact = Fraction(sum(values), len(values))
        spread = sum((v - exact) ** 2 for v in values) / len(values)
        assert mean[channel] == float(exact)
        assert var[channel] == pytest.approx(float(spread), rel=1e-14)


@given(
    spec=geometries([1], 3, 2) | shapes(),
    seed=st.integers(0, 2**32),
    count=st.integers(1, 7),
    batch=st.integers(1, 8),
)
def test_the_batch_is_of_no_importance(
    spec: NetworkSpec, seed: int, count: int, batch: int
) -> None:
    generator = torch.Generator().manual_seed(seed)
    network = BinaryNetwork(spec, scale_initial=1.0, generator=generator)
    D = torch.randint(256, (count, *spec.observation_shape), generator=generator).to(torch.uint8)
    reestimate_batch_norm(network, [D])
    mean, var = network.mean.clone(), network.var.clone()
    reestimate_batch_norm(network, D.flip(0).split(batch))
    assert torch.equal(network.mean, mean)
    assert torch.equal(network.var, var)


def test_squares_of_the_largest_sums_overflow_nothing() -> None:
    """Of all batches together they are beyond 64 bits."""
    o = torch.full((4, 1, 1, 1), 2.0**30)
    mean, var = _moments([o] * 8)
    assert (float(mean[0]), float(var[0])) == (2.0**30, 0.0)


def test_nothing_to_estimate_from_is_said() -> None:
    spec = NetworkSpec(1, 3, 2)
    network = BinaryNetwork(spec, scale_initial=1.0, generator=torch.Generator())
    empty = torch.zeros((0, *spec.observation_shape), dtype=torch.uint8)
    with pytest.raises(ValueError, match="at least 1 observation to estimate from, got 0"):
        reestimate_batch_norm(network, [empty])
