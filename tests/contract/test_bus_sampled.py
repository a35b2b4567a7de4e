import errno
import threading
import time
from collections.abc import Callable

import pytest

from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import AliveToken, TokenWatch
from bpn_shared.bus.sampled import SampledPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryPublisher, TelemetryWatch
from bpn_shared.bus.watch import Subscriber
from bpn_shared.counters import Counters
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runtime.telemetry import Latencies, Reporter, WeightsTimeline
from bpn_shared.waiting import WaitStatus

OpenBus = Callable[[], Bus]
WaitFor = Callable[..., None]


def test_nothing_is_encoded_until_somebody_watches_and_after_they_left(
    open_bus: OpenBus, wait_for: WaitFor
) -> None:
    encoded: list[int] = []

    def encode(number: int) -> tuple[bytes, bytes | None]:
        encoded.append(number)
        return bytes([number]), b"header"

    publisher = SampledPublisher[int](open_bus(), "test/sampled", 1000.0, encode, Counters())
    assert not publisher.has_subscribers
    publisher.publish_latest(1)
    received: list[tuple[bytes, bytes]] = []
    watcher = open_bus()
    watch = Subscriber(
        watcher, "test/sampled", lambda header, data: received.append((header, data))
    )
    wait_for(lambda: publisher.has_subscribers, "the publisher to see that it is watched")
    publisher.publish_latest(2)
    wait_for(lambda: received == [(b"header", b"\x02")], "the item offered while watched")
    watch.close()
    wait_for(lambda: not publisher.has_subscribers, "the publisher to see that nobody watches")
    publisher.publish_latest(3)
    again = Subscriber(
        watcher, "test/sampled", lambda header, data: received.append((header, data))
    )
    wait_for(lambda: publisher.has_subscribers, "the publisher to be watched again")
    publisher.publish_latest(4)
    wait_for(lambda: len(received) == 2, "the item offered after the return")
    assert encoded == [2, 4]
    again.close()
    publisher.close()
    assert "sampled test/sampled" not in {thread.name for thread in threading.enumerate()}


def test_what_cannot_be_encoded_is_counted_and_its_traceback_logged_once(
    open_bus: OpenBus, wait_for: WaitFor, caplog: pytest.LogCaptureFixture
) -> None:
    def encode(number: int) -> tuple[bytes, None]:
        if number < 9:
            raise OSError(errno.EMFILE, "Too many open files")
        return bytes([number]), None

    counters, received = Counters(), []
    publisher = SampledPublisher[int](open_bus(), "test/sampled", 1000.0, encode, counters)
    watch = Subscriber(open_bus(), "test/sampled", lambda _header, data: received.append(data))
    wait_for(lambda: publisher.has_subscribers, "the publisher to see that it is watched")
    for number in range(10):
        publisher.publish_latest(number)
        seen = min(number + 1, 9)
        wait_for(
            lambda seen=seen: counters.snapshot().get("items_not_published") == seen, "the count"
        )
    wait_for(lambda: received == [b"\x09"], "the item that can be encoded")
    assert sum(record.exc_info is not None for record in caplog.records) == 1
    watch.close()
    publisher.close()


def test_the_newest_is_published_at_the_rate_asked_for(
    open_bus: OpenBus, wait_for: WaitFor
) -> None:
    received: list[int] = []
    rate_hz = 50.0
    publisher = SampledPublisher[int](
        open_bus(),
        "test/sampled",
        rate_hz,
        lambda number: (number.to_bytes(4, "big"), None),
        Counters(),
    )
    watch = Subscriber(
        open_bus(),
        "test/sampled",
        lambda _header, data: received.append(int.from_bytes(data, "big")),
    )
    wait_for(lambda: publisher.has_subscribers, "the publisher to see that it is watched")
    start_s, offered = time.monotonic(), 0
    while time.monotonic() - start_s < 0.5:
        offered += 1
        publisher.publish_latest(offered)
    elapsed_s = time.monotonic() - start_s
    wait_for(lambda: received and received[-1] == offered, "the last item")
    assert received == sorted(received)
    assert len(received) <= elapsed_s * rate_hz + 2 < offered
    watch.close()
    publisher.close()


def test_telemetry_of_every_service_reaches_the_watcher(
    open_bus: OpenBus, wait_for: WaitFor
) -> None:
    heard: list[Telemetry] = []
    counters = Counters()
    watching = open_bus()
    watch = TelemetryWatch(watching, heard.append, counters)
    publishers, told = [], Counters()
    for name in ("edge-1", "edge-2"):
        bus = open_bus()
        reporter = Reporter(
            "edge", name, lambda: (None, None), bus.traffic, waiting=WaitStatus(),
            counters=told, latencies=Latencies(), weights=WeightsTimeline(),
        )  # fmt: skip
        publishers.append(TelemetryPublisher(bus, "edge", name, reporter.report, Counters()))
    wait_for(lambda: {h.worker for h in heard} == {"edge-1", "edge-2"}, "both services' reports")
    watching.zenoh.put(keys.telemetry("edge", "edge-3"), b"garbage")
    wait_for(lambda: counters.snapshot() == {"telemetry_refused": 1}, "garbage to be refused")
    told.add("at_the_end")
    for publisher in publishers:
        publisher.close()
    # what happened since the last second is not lost with who tells it
    wait_for(
        lambda: {h.worker for h in heard if "at_the_end" in h.counters} == {"edge-1", "edge-2"},
        "both services' last reports",
    )
    watch.close()


def test_tokens_of_every_kind_are_seen_come_and_go(open_bus: OpenBus, wait_for: WaitFor) -> None:
    changes: list[tuple[str, bool]] = []
    early = open_bus()
    token = AliveToken(early, "edge", "edge-1")
    watch = TokenWatch(open_bus(), keys.live("*", "*"), lambda *change: changes.append(change))
    wait_for(
        lambda: changes == [(keys.live("edge", "edge-1"), True)], "the token that was there before"
    )
    late = open_bus()
    other = AliveToken(late, "learner", "learner-1")
    wait_for(
        lambda: changes[1:] == [(keys.live("learner", "learner-1"), True)],
        "the token that came later",
    )
    late.close()
    wait_for(lambda: changes[2:] == [(keys.live("learner", "learner-1"), False)], "the token to go")
    del token, other
    watch.close()
