import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_edge.kernel.native import NativeKernel
from bpn_edge.memory import WeightMemory
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.weights import NO_RANK
from bpn_shared.counters import Counters
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(1, 40, 14)
RNG = np.random.default_rng(1)
BLOBS = [replace(WeightBlob.random(SPEC, RNG), attempt=1, version=version) for version in range(3)]
IMAGE = RNG.integers(0, 256, SPEC.observation_shape, dtype=np.uint8)


@pytest.fixture
def memory() -> WeightMemory:
    return WeightMemory("native", Counters())


def expect_version(memory: WeightMemory, version: int) -> None:
    assert memory.weights is not None
    assert memory.weights.version == version
    np.testing.assert_array_equal(memory.run(IMAGE), golden.forward(BLOBS[version], IMAGE)[-1])


def test_a_new_version_runs_only_after_the_swap(memory: WeightMemory) -> None:
    memory.offer(BLOBS[0])
    assert memory.activate(0, timeout_s=0)
    expect_version(memory, 0)
    memory.offer(BLOBS[1])
    expect_version(memory, 0)  # the other bank was filled, this one still runs
    assert memory.activate(1, timeout_s=0)
    expect_version(memory, 1)


def test_a_version_that_was_not_offered_does_not_run(memory: WeightMemory) -> None:
    assert not memory.activate(0, timeout_s=0)
    memory.offer(BLOBS[0])
    memory.activate(0, timeout_s=0)
    assert not memory.activate(2, timeout_s=0)
    expect_version(memory, 0)


def test_a_later_offer_replaces_the_waiting_one(memory: WeightMemory) -> None:
    memory.offer(BLOBS[0])
    memory.activate(0, timeout_s=0)
    memory.offer(BLOBS[1])
    memory.offer(BLOBS[2])
    assert memory.activate(2, timeout_s=0)
    expect_version(memory, 2)


def test_the_same_version_of_a_later_attempt_takes_over(memory: WeightMemory) -> None:
    memory.offer(BLOBS[0])
    memory.activate(0, timeout_s=0)
    memory.offer(replace(BLOBS[0], attempt=2))
    assert memory.activate(0, timeout_s=0)
    assert memory.weights is not None
    assert memory.weights.attempt == 2
    expect_version(memory, 0)


def test_activation_waits_for_the_offer(memory: WeightMemory) -> None:
    thread = threading.Thread(target=memory.offer, args=(BLOBS[1],))
    thread.start()
    assert memory.activate(1, timeout_s=20)
    thread.join()
    expect_version(memory, 1)


def test_news_of_a_version_wake_who_waits(memory: WeightMemory) -> None:
    assert not memory.wait_newer(None, timeout_s=0)
    thread = threading.Thread(target=memory.offer, args=(BLOBS[1],))
    thread.start()
    assert memory.wait_newer(None, timeout_s=20)
    thread.join()
    assert not memory.wait_newer(1, timeout_s=0)
    assert memory.wait_newer(0, timeout_s=0)  # it came between the question and the wait


def test_the_newest_is_told_by_version_and_by_rank(memory: WeightMemory) -> None:
    assert (memory.newest, memory.rank) == (None, NO_RANK)
    memory.offer(replace(BLOBS[2], attempt=5))
    assert (memory.newest, memory.rank) == (2, (5, 2))


def test_a_bank_that_computes_wrongly_is_not_used(
    memory: WeightMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory.offer(BLOBS[0])
    memory.activate(0, timeout_s=0)
    other = WeightBlob.random(SPEC, RNG)
    # stands for a stuck memory bit: what is loaded is not what was sent
    load = type(memory._idle).load
    monkeypatch.setattr(type(memory._idle), "load", lambda bank, _blob: load(bank, other))
    memory.offer(BLOBS[1])
    assert not memory.activate(1, timeout_s=0)
    assert memory._counters.snapshot() == {"weights_failed_verification": 1}
    expect_version(memory, 0)


def test_a_bad_offer_takes_the_waiting_one_with_it(
    memory: WeightMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was loaded over it: what the bank holds then must not run under the other one's name."""
    memory.offer(BLOBS[0])
    memory.activate(0, timeout_s=0)
    memory.offer(BLOBS[1])
    assert memory.rank == (1, 1)
    load = type(memory._idle).load
    with monkeypatch.context() as once:
        once.setattr(type(memory._idle), "load", lambda bank, _blob: load(bank, BLOBS[0]))
        assert not memory.offer(BLOBS[2])
    assert memory.rank == (1, 0)  # so that version 1 is taken when it is offered again
    assert not memory.activate(1, timeout_s=0)
    expect_version(memory, 0)
    assert memory.offer(BLOBS[1])
    assert memory.activate(1, timeout_s=0)
    expect_version(memory, 1)


@given(st.lists(st.tuples(st.integers(1, 3), st.integers(0, 2), st.booleans()), max_size=8))
@settings(max_examples=60)
def test_what_runs_is_always_a_policy_that_passed(offers: list[tuple[int, int, bool]]) -> None:
    memory = WeightMemory("golden", Counters())
    bad = WeightBlob.random(SPEC, np.random.default_rng(99))
    load = type(memory._idle).load
    for attempt, version, passes in offers:
        blob = replace(BLOBS[version], attempt=attempt)
        with pytest.MonkeyPatch.context() as patch:
            if not passes:
                patch.setattr(type(memory._idle), "load", lambda bank, _blob: load(bank, bad))
            assert memory.offer(blob) == passes
        assert (memory.rank == (attempt, version)) or not passes
        for wanted in range(3):
            if memory.activate(wanted, timeout_s=0, attempt=attempt):
                assert memory.weights is not None
                assert memory.weights.attempt >= attempt
                expect_version(memory, wanted)


def test_an_episode_wants_weights_of_its_own_attempt_or_a_later_one(memory: WeightMemory) -> None:
    memory.offer(BLOBS[1])
    assert memory.activate(1, timeout_s=0, attempt=1)
    assert not memory.activate(1, timeout_s=0, attempt=2)
    memory.offer(replace(BLOBS[1], attempt=3))
    assert memory.activate(1, timeout_s=0, attempt=2)
    assert memory.weights is not None
    assert memory.weights.attempt == 3


def test_a_flipped_bit_of_the_running_bank_is_noticed_at_the_next_activation(
    memory: WeightMemory,
) -> None:
    memory.offer(BLOBS[0])
    assert memory.activate(0, timeout_s=0)
    assert isinstance(memory._active, NativeKernel)
    memory._active.network.memory()[4000] ^= 8
    assert not memory.activate(0, timeout_s=0)
    assert memory._counters.snapshot() == {"weights_damaged": 1}
    assert (memory.rank, memory.newest) == (NO_RANK, None)
    assert memory.offer(BLOBS[0])
    assert memory.activate(0, timeout_s=0)
    expect_version(memory, 0)


def test_the_same_failure_three_times_is_hopeless_and_forgotten_when_it_passes(
    memory: WeightMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_bank: object, _blob: WeightBlob) -> None:
        raise OSError("Input/output error")  # a device's

    with monkeypatch.context() as failing:
        failing.setattr(type(memory._idle), "load", broken)
        for times in range(3):
            assert (memory.why_never(1) is None) == (times < 3)
            assert not memory.offer(BLOBS[1])
        assert memory.why_never(1) == (
            "weights version 1 failed the verification 3 times: Input/output error"
        )
        assert memory.why_never(0) is None
    assert memory.offer(BLOBS[1])
    assert memory.why_never(1) is None
