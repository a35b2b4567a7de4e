import threading
from dataclasses import replace

import numpy as np
import pytest

from bpn_edge.memory import WeightMemory
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.spec import NetworkSpec
from bpn_shared.service import Counters

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
