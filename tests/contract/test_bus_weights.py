import re
from collections.abc import Callable
from dataclasses import replace
from uuid import UUID

import numpy as np
import pytest

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.weights import NO_RANK
from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.liveliness import AliveToken
from bpn_shared.bus.session import Bus
from bpn_shared.bus.weights import WeightsPublisher, WeightsSubscriber, _encode_header
from bpn_shared.counters import Counters
from bpn_shared.spec.network import NetworkSpec

OpenBus = Callable[[], Bus]
WaitFor = Callable[..., None]
RUN = UUID(int=7)
SPEC = NetworkSpec(1, 16, 4)
BASE = replace(WeightBlob.random(SPEC, np.random.default_rng(0)), run=RUN)


def blob(attempt: int, version: int) -> WeightBlob:
    return replace(BASE, attempt=attempt, version=version)


class Edge:
    """Collects what a subscriber hands on."""

    def __init__(self, bus: Bus) -> None:
        self.got: list[tuple[int, int]] = []
        self.counters = Counters()
        self.subscriber = WeightsSubscriber(
            bus,
            RUN,
            SPEC,
            lambda policy: self.got.append((policy.attempt, policy.version)),
            self.counters,
            held=lambda: max(self.got, default=NO_RANK),
            kind="binary",
        )

    @property
    def newest(self) -> tuple[int, int] | None:
        return self.got[-1] if self.got else None


def test_an_edge_that_starts_late_has_the_newest_at_once(
    open_bus: OpenBus, wait_for: WaitFor
) -> None:
    publisher = WeightsPublisher(open_bus(), RUN)
    for version in range(8):
        publisher.publish(blob(1, version))
    first = Edge(open_bus())  # it may come before the router has heard of the learner
    wait_for(lambda: first.newest == (1, 7), "version 7")
    assert Edge(open_bus()).got == [(1, 7)]


def test_an_edge_that_waits_gets_what_is_published(open_bus: OpenBus, wait_for: WaitFor) -> None:
    listening, learner = open_bus(), open_bus()
    edge = Edge(listening)
    publisher = WeightsPublisher(learner, RUN)
    publisher.publish(blob(1, 0))
    token = AliveToken(learner, "learner", "learner-1")  # makes the edge ask again
    wait_for(lambda: edge.newest == (1, 0), "version 0")
    publisher.publish(blob(1, 1))
    wait_for(lambda: edge.newest == (1, 1), "version 1")
    size_bytes = len(blob(1, 1).encode())
    for tally in (
        learner.traffic.sent(keys.weights(RUN)),
        listening.traffic.received(keys.weights(RUN)),
    ):
        assert (tally.messages, tally.bytes) == (2, 2 * size_bytes)
    del token


def test_after_a_restart_the_higher_attempt_wins(open_bus: OpenBus, wait_for: WaitFor) -> None:
    edge = Edge(open_bus())
    old = WeightsPublisher(open_bus(), RUN)
    old.publish(blob(1, 7))
    edge.subscriber.refresh()
    new_learner = open_bus()
    new = WeightsPublisher(new_learner, RUN)
    new.publish(blob(2, 5))
    token = AliveToken(new_learner, "learner", "learner-2")
    wait_for(lambda: edge.newest == (2, 5), "attempt 2")
    old.publish(blob(1, 8))  # a learner that does not know it was replaced
    edge.subscriber.refresh()
    new.publish(blob(2, 6))
    wait_for(lambda: edge.newest == (2, 6), "version 6 of attempt 2")
    assert (1, 8) not in edge.got
    del token


def test_of_two_learners_that_answer_the_higher_attempt_is_taken(
    open_bus: OpenBus, wait_for: WaitFor
) -> None:
    """One that does not know it was replaced may answer before, and after, the one that replaced it."""
    learners = [WeightsPublisher(open_bus(), RUN) for _ in range(3)]
    for learner, newest in zip(learners, (blob(1, 8), blob(2, 5), blob(1, 7)), strict=True):
        learner.publish(newest)
    edge = Edge(open_bus())

    def asked() -> bool:
        edge.subscriber.refresh()
        return edge.newest == (2, 5)

    wait_for(asked, "attempt 2")
    assert Edge(open_bus()).newest == (2, 5)  # all three are known to the router by now


GOOD = blob(1, 1)


def _flipped(data: bytes) -> bytes:
    """One byte among the weights is another."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :]


@pytest.mark.parametrize(
    ("header", "payload", "reason"),
    [
        (b"", GOOD.encode(), "header of 0 bytes, expected 9"),
        (
            b"\x02" + _encode_header(GOOD)[1:],
            GOOD.encode(),
            "header schema 2, this program reads 1",
        ),
        (_encode_header(GOOD), GOOD.encode()[:-1], "bytes of a weight blob, the header tells of"),
        (_encode_header(GOOD), GOOD.encode() + b"x", "bytes, a binary policy with"),
        (_encode_header(GOOD), bytes(len(GOOD.encode())), "starts with"),
        (_encode_header(GOOD), _flipped(GOOD.encode()), "SHA-256"),
        (
            _encode_header(blob(1, 2)),
            GOOD.encode(),
            r"version\) \(1, 2\), the policy says otherwise",
        ),
        (
            _encode_header(GOOD),
            replace(GOOD, run=UUID(int=8)).encode(),
            "belongs to run 0+-.*8, this",
        ),
        (
            _encode_header(GOOD),
            WeightBlob.random(NetworkSpec(1, 15, 4), np.random.default_rng(0)).encode(),
            r"geometry C=1, N=15, .* this edge runs C=1, N=16",
        ),
        (
            _encode_header(GOOD),
            FloatWeights(SPEC, b"model", np.zeros(4, np.float32)).encode(),
            "a float policy, this edge runs binary ones",
        ),
    ],
    ids=[
        "no header",
        "another schema",
        "truncated",
        "oversized",
        "zeros",
        "flipped",
        "version",
        "run",
        "geometry",
        "float",
    ],
)
def test_what_is_not_this_runs_weights_is_refused_and_counted(
    open_bus: OpenBus, wait_for: WaitFor, header: bytes, payload: bytes, reason: str
) -> None:
    edge = Edge(open_bus())
    bus = open_bus()
    stranger = LatestPublisher(bus, keys.weights(RUN), "frame")

    def refused() -> bool:
        stranger.put(payload, attachment=header)
        return edge.counters.snapshot().get("weights_refused", 0) > 0

    wait_for(refused, "the refusal to be counted")
    assert re.search(reason, edge.counters.reasons()["weights_refused"])
    assert edge.got == []
    WeightsPublisher(open_bus(), RUN).publish(blob(1, 1))
    edge.subscriber.refresh()
    wait_for(lambda: edge.newest == (1, 1), "the true version 1 after the false one")
