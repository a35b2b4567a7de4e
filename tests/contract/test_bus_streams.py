from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from bpn_shared.bus.latest import LatestPublisher, LatestSubscriber
from bpn_shared.bus.liveliness import Alive, AliveToken
from bpn_shared.bus.session import Bus

OpenBus = Callable[[], Bus]
WaitFor = Callable[..., None]


def test_only_the_newest_is_taken(open_bus: OpenBus, wait_for: WaitFor) -> None:
    subscriber = LatestSubscriber(open_bus(), "test/frame")
    publisher = LatestPublisher(open_bus(), "test/frame", "frame")

    def first_arrives() -> bool:
        publisher.put(b"first")
        return subscriber.take(0.05) is not None

    wait_for(first_arrives, "the subscription to reach the publisher")
    while subscriber.take(0.1) is not None:
        pass
    for number in range(5):
        seen = subscriber.received
        publisher.put(bytes([number]), attachment=b"header")
        wait_for(lambda seen=seen: subscriber.received > seen, f"message {number}")
    newest = subscriber.take(0)
    assert newest is not None
    assert (newest.payload, newest.attachment) == (b"\x04", b"header")
    assert subscriber.take(0) is None


def test_a_waiting_take_can_be_woken_and_no_wake_is_lost(open_bus: OpenBus) -> None:
    subscriber = LatestSubscriber(open_bus(), "test/frame")
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(subscriber.take, 30)
        subscriber.wake()  # before or while it waits: the test cannot know, and need not
        assert waiting.result(5) is None


def test_the_living_are_seen_by_early_and_late_watchers(
    open_bus: OpenBus, wait_for: WaitFor
) -> None:
    early = Alive(open_bus(), "edge")
    worker = open_bus()
    token = AliveToken(worker, "edge", "edge-1")
    wait_for(lambda: "edge-1" in early, "the early watcher to see edge-1")
    late = Alive(open_bus(), "edge")
    wait_for(lambda: late.workers() == {"edge-1"}, "the late watcher to see edge-1")
    worker.close()
    wait_for(lambda: "edge-1" not in early and not late.workers(), "both to see it go")
    del token
