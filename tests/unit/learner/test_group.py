"""Learners that share minibatches learn what one alone learns, over real gloo connections."""

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np
import pytest
import torch
from geometries import geometries
from hypothesis import HealthCheck, assume, example, given, settings
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

from bpn_learner.factory import initial_policy
from bpn_learner.gathering import RegressionBatch
from bpn_learner.group import SINGLE_PROCESS, DistributedGroup, Group, GroupLostError
from bpn_learner.handout import broadcast_state, receive_state
from bpn_learner.minibatch import minibatch_gradients
from bpn_learner.networks import PNetwork
from bpn_learner.rendezvous import connect, open_store
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import UpdateConfig, fit, policy_update
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.network import NetworkSpec
from bpn_shared.spec.sections import Backend
from bpn_shared.spec.seeds import shuffle_generator

LOOPBACK = "127.0.0.1"
Kind = Literal["binary", "float"]


class Members:
    """As many threads as a group has members, each with its end of the group."""

    def __init__(self, size: int) -> None:
        listening = socket.create_server((LOOPBACK, 0))
        port: int = listening.getsockname()[1]
        first = open_store(LOOPBACK, port, listening.detach())
        self.size = size
        self.groups: dict[int, DistributedGroup] = {}

        def enter(rank: int) -> None:
            store = open_store(LOOPBACK, port) if rank else first
            config = RunConfig.for_task("reaching", learners=size)
            self.groups[rank] = connect(store, LOOPBACK, rank, config)

        self._in_threads(enter)

    def _in_threads(self, work: Callable[[int], object]) -> list[Any]:
        results: dict[int, Any] = {}

        def run(rank: int) -> None:
            torch.set_num_threads(1)
            try:
                results[rank] = work(rank)
            except BaseException as error:
                results[rank] = error
                if rank in self.groups:
                    self.groups[rank].close()  # or the others would wait for it

        threads = [threading.Thread(target=run, args=(rank,)) for rank in range(self.size)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
        errors = [result for result in results.values() if isinstance(result, BaseException)]
        for error in errors:
            if not isinstance(error, GroupLostError):
                raise error
        return [results[rank] for rank in range(self.size)]

    def __call__(self, work: Callable[[DistributedGroup], object]) -> list[Any]:
        """What the work returns at every rank; lost groups are results, other errors are raised."""
        return self._in_threads(lambda rank: work(self.groups[rank]))

    def close(self) -> None:
        for group in self.groups.values():
            group.close()


@pytest.fixture(scope="module", params=[2, 3])
def members(request: pytest.FixtureRequest) -> Iterator[Members]:
    made = Members(request.param)
    yield made
    made.close()


@pytest.mark.parametrize("backend", ["native", "torch"])
@pytest.mark.parametrize("kind", ["binary", "float"])
@settings(
    max_examples=12, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    spec=geometries(range(1, 7), 60, 20),
    B=st.integers(2, TRANSITIONS),
    seed=st.integers(0, 1000),
)
@example(spec=NetworkSpec(channels=6, hidden_units=100, actions=7), B=TRANSITIONS, seed=0)
@example(
    spec=NetworkSpec(channels=1, hidden_units=16, actions=2), B=2, seed=2
)  # less than one for each of 3
def test_a_shared_minibatch_has_the_gradients_of_the_whole(
    members: Members, kind: Kind, backend: Backend, spec: NetworkSpec, B: int, seed: int
) -> None:
    make = binary_network if kind == "binary" else float_network
    pixels, actions, y = data(spec, seed)
    observations = pixels.permute(0, 3, 1, 2)
    batch = torch.randperm(TRANSITIONS, generator=torch.Generator().manual_seed(seed))[:B]
    alone = make(spec, seed)
    if kind == "binary":
        # Closer, and float32's rounding decides which side of the jump a value is on.
        assume(margin(alone, pixels[batch]) > 2e-6)
    exact = exact_gradients(alone, pixels, actions, y, batch)
    whole = named_gradients(
        alone, minibatch_gradients(backend, alone, observations, actions, y), batch
    )

    def shared(group: DistributedGroup) -> dict[str, Tensor]:
        network = make(spec, seed)
        gradients = minibatch_gradients(backend, network, observations, actions, y, group=group)
        return named_gradients(network, gradients, batch)

    first, *others = members(shared)
    assert first.keys() == whole.keys()
    for name, gradient in exact.items():
        for other in others:
            assert torch.equal(first[name], other[name]), f"{name} differs between members"
        rounding = distance(whole[name], gradient)
        assert distance(first[name], gradient) < 2e-5 + 4 * rounding, f"{name}, alone: {rounding}"


def config_of(kind: Kind, learners: int, **changes: Any) -> RunConfig:
    return RunConfig.for_task(
        "reaching",
        algorithm="bpn" if kind == "binary" else "cvi",
        hidden_units=24,
        epochs=2,
        batch_size=8,
        learners=learners,
        **changes,
    )


def transitions() -> Transitions:
    rng = np.random.default_rng(0)
    episodes = [
        EpisodeData(
            frames=rng.integers(0, 256, (11, 1, 84, 84), np.uint8),
            actions=rng.integers(0, 14, 10),
            rewards=rng.normal(size=10),
            terminated=False,
        )
        for _ in range(3)
    ]
    return Transitions.from_episodes(episodes, frames_stacked=1)


def one_update(
    network: PNetwork,
    optimizer: torch.optim.Optimizer,
    config: RunConfig,
    iteration: int,
    group: DistributedGroup | None,
) -> None:
    """As the learner of that rank does it."""
    settings = UpdateConfig.of_iteration(config, iteration)
    rng = shuffle_generator(config.seed, iteration)
    if group is not None and group.rank > 0:
        regression, told = receive_state(group, network, optimizer)
        assert told == iteration
        fit(network, optimizer, regression, settings, rng, group=group)
        return

    @contextlib.contextmanager
    def gather(regression: RegressionBatch) -> Iterator[Group]:
        if group is not None:
            broadcast_state(group, network, optimizer, regression, iteration)
        yield group or SINGLE_PROCESS

    policy_update(network, optimizer, transitions(), settings, rng, gather=gather)


def updated(config: RunConfig, group: DistributedGroup | None) -> dict[str, Tensor]:
    """The parameters after two updates, at any rank."""
    # Whatever a member begins with: all that counts is told.
    rank = 0 if group is None else group.rank
    network, optimizer = initial_policy(config.model_copy(update={"seed": rank}))
    for iteration in range(2):
        one_update(network, optimizer, config, iteration, group)
    return {name: value.detach().clone() for name, value in network.named_parameters()}


# Not binary and plain: alone that backend has torch's batch norm, in whose float32 rounding decides on ties.
@pytest.mark.parametrize(
    ("kind", "backend"), [("binary", "native"), ("float", "native"), ("float", "torch")]
)
def test_shared_updates_end_where_those_of_one_learner_do(
    members: Members, kind: Kind, backend: Backend
) -> None:
    alone = updated(config_of(kind, 1, backend=backend), None)
    config = config_of(kind, members.size, backend=backend)
    first, *others = members(lambda group: updated(config, group))
    initial = dict(initial_policy(config)[0].named_parameters())
    for name, value in alone.items():
        moved = float((value - initial[name]).detach().abs().max())
        assert moved > 1e-3, f"{name} did not learn"
        # Where a gradient is all rounding, Adam makes a step of it: a few single weights may differ.
        differences = (first[name] - value).abs()
        assert float(differences.mean()) < 1e-4 * moved, name
        assert float(differences.max()) < 0.2 * moved, name
        for other in others:
            assert torch.equal(first[name], other[name]), f"{name} differs between members"
    again = members(lambda group: updated(config, group))[0]
    for name, value in again.items():
        assert torch.equal(first[name], value), f"{name}: not the same bits again"


def test_when_one_is_lost_all_others_give_the_update_up() -> None:
    lonely = Members(3)
    config = config_of("binary", 3, seed=1)

    def work(group: DistributedGroup) -> object:
        if group.rank == 1:
            receive_state(group, *initial_policy(config))
            raise GroupLostError("dies")
        return updated(config, group)

    try:
        results = lonely(work)
    finally:
        lonely.close()
    assert all(isinstance(result, GroupLostError) for result in results)
    assert "left the group" not in str(results[0])


def test_an_update_of_another_run_is_refused(members: Members) -> None:
    mine, theirs = config_of("binary", members.size), config_of("float", members.size)

    def work(group: DistributedGroup) -> None:
        if group.rank == 0:
            D = transitions()
            regression = RegressionBatch(D.frames, D.observations, D.actions, D.rewards)
            broadcast_state(group, *initial_policy(mine), regression, 0)
        else:
            with pytest.raises(GroupLostError, match="no update of this run"):
                receive_state(group, *initial_policy(theirs))

    members(work)
