"""A recorded step is the plain one: no step more or less, from the minibatches and rates of the moment."""

import copy
from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from minibatches import TRANSITIONS, binary_network, data
from torch import Tensor

from bpn_learner.group import SINGLE_PROCESS
from bpn_learner.minibatch import autograd_gradients
from bpn_learner.networks import BinaryNetwork
from bpn_learner.steps import RecordedStep, Step, best_step, plain_step, recordable
from bpn_learner.update import make_optimizer, set_learning_rate
from bpn_shared.spec.network import Convolution, NetworkSpec

SPEC = NetworkSpec(2, 9, 3, convolutions=(Convolution(4, 3, 5),), image_px=16)
NETWORK = binary_network(SPEC, 0)
DATA = data(SPEC, 0)


class OnTheProcessor:
    """Records as a GPU does: fixed tensors, nothing is done before it is replayed."""

    def __init__(self) -> None:
        self.warmed_up = self.recorded = self.replayed = 0

    def warm_up(self, work: Callable[[], Tensor]) -> Tensor:
        self.warmed_up += 1
        return work()

    def record(self, work: Callable[[], Tensor]) -> tuple[Callable[[], None], Tensor]:
        self.recorded += 1
        result = torch.empty(())

        def replay() -> None:
            self.replayed += 1
            result.copy_(work())

        return replay, result


def trained(
    batches: list[Tensor], rates: list[float], made: Callable[[Step], Step], *, tensors: bool
) -> tuple[BinaryNetwork, list[float]]:
    network = copy.deepcopy(NETWORK)
    optimizer = make_optimizer(network, 1e-2)
    step = made(plain_step(autograd_gradients(network, *DATA), network, optimizer))
    losses = []

    def train() -> None:
        for batch, rate in zip(batches, rates, strict=True):
            set_learning_rate(optimizer, rate)
            losses.append(float(step(batch)))

    if tensors:
        with recordable(optimizer):
            train()
    else:
        train()
    assert [group["lr"] for group in optimizer.param_groups] == pytest.approx(
        [group["initial_lr"] * (1 if tensors else rates[-1]) for group in optimizer.param_groups]
    )
    assert not any(group["capturable"] for group in optimizer.param_groups)
    return network, losses


@settings(max_examples=20, derandomize=True, deadline=None)
@given(sizes=st.lists(st.sampled_from([2, 5, 8]), min_size=1, max_size=14), seed=st.integers(0, 99))
def test_recorded_and_plain_steps_train_alike(sizes: list[int], seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    batches = [torch.randperm(TRANSITIONS, generator=generator)[:size] for size in sizes]
    rates = torch.rand(len(sizes), generator=generator).tolist()
    recorder = OnTheProcessor()
    plain, losses = trained(batches, rates, lambda step: step, tensors=True)
    found, recorded = trained(
        batches, rates, lambda step: RecordedStep(step, recorder), tensors=True
    )
    assert recorded == losses
    for name, value in plain.state_dict().items():
        assert torch.equal(found.state_dict()[name], value), name
    warm_ups = [min(sizes.count(size), RecordedStep.WARM_UPS) for size in set(sizes)]
    assert recorder.warmed_up == sum(warm_ups)
    assert recorder.recorded == sum(
        sizes.count(size) > RecordedStep.WARM_UPS for size in set(sizes)
    )
    assert recorder.replayed == len(sizes) - recorder.warmed_up


def test_rates_in_tensors_are_the_rates() -> None:
    batches, rates = [torch.arange(8)] * 6, [1.0, 0.8, 0.6, 0.4, 0.2, 0.1]
    plain, losses = trained(batches, rates, lambda step: step, tensors=False)
    found, others = trained(batches, rates, lambda step: step, tensors=True)
    assert others == pytest.approx(losses, rel=1e-4)
    torch.testing.assert_close(found.latent, plain.latent, rtol=1e-4, atol=1e-5)


class TwoMembers:
    size = 2

    def shard(self, batch: Tensor) -> Tensor:
        return batch

    def all_reduce_sum(self, values: Tensor) -> None:
        values.mul_(2)


@pytest.mark.parametrize("group", [SINGLE_PROCESS, TwoMembers()])
def test_processors_and_groups_take_plain_steps(group: TwoMembers) -> None:
    network = copy.deepcopy(NETWORK)
    optimizer = make_optimizer(network, 1e-2)
    gradients = autograd_gradients(network, *DATA)
    with best_step(gradients, network, optimizer, group=group) as step:
        assert not isinstance(step, RecordedStep)
        assert not isinstance(optimizer.param_groups[0]["lr"], Tensor)
