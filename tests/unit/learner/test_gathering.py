"""Minibatches are the same bits whether observations are gathered at once or for each of them."""

from collections.abc import Callable, Iterator

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from minibatches import binary_network, float_network, named_gradients
from torch import Tensor

from bpn_learner.gathering import RegressionBatch, gathered_gradients
from bpn_learner.networks import PNetwork
from bpn_learner.transitions import gather_observations
from bpn_learner.update import EVALUATION_BATCH, preferences
from bpn_shared.spec.network import NetworkSpec
from bpn_shared.spec.sections import Backend

BATCH = 8
Make = Callable[[NetworkSpec, int], PNetwork]


def regression(spec: NetworkSpec, stacked: int, seed: int, count: int = 20) -> RegressionBatch:
    generator = torch.Generator().manual_seed(seed)

    def drawn(high: int, *shape: int) -> Tensor:
        return torch.randint(high, shape, generator=generator)

    shape = (spec.channels // stacked, spec.image_px, spec.image_px)
    return RegressionBatch(
        frames=drawn(256, 15, *shape).to(torch.uint8),
        observations=drawn(15, count, stacked),
        actions=drawn(spec.actions, count),
        y=torch.randn(count, generator=generator),
    )


@pytest.mark.parametrize("backend", ["native", "torch"])
@pytest.mark.parametrize("make", [binary_network, float_network])
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.integers(1, 2), st.integers(0, 99), st.lists(st.integers(2, BATCH), min_size=1, max_size=3)
)
def test_gathered_for_each_minibatch_they_are_those_gathered_at_once(
    make: Make, backend: Backend, stacked: int, seed: int, sizes: list[int]
) -> None:
    spec = NetworkSpec(channels=2, hidden_units=9, actions=3)
    data, network = regression(spec, stacked, seed), make(spec, seed)
    at_once = gathered_gradients(backend, network, data, BATCH)
    anew = gathered_gradients(backend, network, data, BATCH, at_once_bytes=0)
    for size in sizes:  # a smaller one after a larger one sees nothing of it
        batch = torch.randperm(len(data.y))[:size]
        expected = named_gradients(network, at_once, batch)
        found = named_gradients(network, anew, batch)
        assert expected.keys() == found.keys()
        assert all(torch.equal(found[name], expected[name]) for name in expected)


def test_preferences_need_only_a_part_of_the_observations_in_memory() -> None:
    spec = NetworkSpec(channels=2, hidden_units=9, actions=3)
    data, network = regression(spec, 2, 1, 2 * EVALUATION_BATCH + 1), binary_network(spec, 1)
    alive: list[int] = []

    def parts() -> Iterator[Tensor]:
        for part in data.observations.split(EVALUATION_BATCH):
            alive.append(len(part))
            yield gather_observations(data.frames, part)

    found = preferences(network, parts())
    assert alive == [EVALUATION_BATCH, EVALUATION_BATCH, 1]
    everything = gather_observations(data.frames, data.observations)
    assert torch.equal(found, preferences(network, [everything]))
