"""A client's place in a topic, without a network: what it is given when, and what it is told is missing."""

import asyncio
import json
from collections.abc import Callable
from typing import Any
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.hub.channel import MAX_KEPT_BYTES, CameraFrame, Channel
from bpn_dashboard.hub.client import Subscription
from bpn_dashboard.hub.protocol import CREDIT, LiveFrame, Subscribe
from bpn_dashboard.hub.topics import Topic

METRICS, CAMERA = Topic("metrics", UUID(int=1)), Topic("camera", UUID(int=1), 0)


class Loop(asyncio.SelectorEventLoop):
    """Runs only when it is told to: several messages may arrive before the loop gets to look."""

    def drain(self) -> None:
        self.call_soon(self.stop)
        self.run_forever()


@pytest.fixture
def loop() -> Any:
    made = Loop()
    yield made
    made.close()


def channel(
    loop: Loop, topic: Topic = METRICS, kept: int = 5, decode: Callable[[int], Any] | None = None
) -> Channel[int]:
    return Channel(topic, kept, decode or (lambda number: str(number).encode()), loop)


def frame(number: int) -> CameraFrame:
    return CameraFrame(float(number), 1, 1, 1, 1, bytes([number % 256]))


def subscription(of: Channel[int], since: int | None = None, **more: Any) -> Subscription:
    return Subscription(Subscribe(op="sub", id=7, topic=str(of.topic), since=since, **more), of)


def taken(of: Subscription, now_s: float = 1e9) -> list[tuple[str, int | None]]:
    """What is sent: ("data", seq) and ("gap", missed)."""
    said = [json.loads(message) for message in of.take(now_s)]
    return [(m["op"], m["seq"] if m["op"] == "data" else m["missed"]) for m in said]


@given(
    st.lists(st.sampled_from(["put", "look", "read"]), max_size=60),
    st.integers(1, 8),
    st.none() | st.integers(0, 5),
    st.sets(st.integers(0, 60)),
)
def test_every_message_is_delivered_in_order_or_counted_as_missed(
    events: list[str], kept: int, since: int | None, refused: set[int]
) -> None:
    """Whatever was put, however slowly the loop looks and the client reads, and whatever did not decode."""
    loop = Loop()
    published = channel(loop, kept=kept, decode=lambda n: None if n in refused else str(n).encode())
    for number in range(100, 105):
        published.put(number)
        loop.drain()
    place = subscription(published, since=since)
    expected, now_s = (published.seq if since is None else since) + 1, 0.0
    for number, event in enumerate([*events, "look", "read", "put", "look", "read"]):
        if event == "put":
            published.put(number)
        elif event == "look":
            loop.drain()
        else:
            now_s += 1.0
            for kind, count in taken(place, now_s):
                assert count is not None
                if kind == "gap":
                    assert count > 0
                    expected += count
                else:
                    assert count == expected
                    expected += 1
    assert expected == published.seq + 1
    loop.close()


@given(st.lists(st.integers(1, 4), min_size=1, max_size=30))
def test_frames_are_the_newest_and_never_more_than_the_credit(bursts: list[int]) -> None:
    loop = Loop()
    camera = channel(loop, CAMERA, kept=1, decode=frame)
    place = subscription(camera)
    sent: list[int] = []
    number = 0
    for now_s, burst in enumerate(bursts):
        for _ in range(burst):
            number += 1
            camera.put(number)
        loop.drain()
        for message in place.take(float(now_s)):
            assert isinstance(message, bytes)
            header, pixels = LiveFrame.decode(message)
            assert pixels == bytes([number % 256])
            sent.append(header.seq)
        assert len(sent) <= CREDIT
        if len(sent) == CREDIT and now_s % 3 == 0:
            place.acknowledge(sent[-1])
            sent.clear()
    loop.close()


def test_acknowledging_gives_back_as_many_as_are_done_with(loop: Loop) -> None:
    camera = channel(loop, CAMERA, kept=1, decode=frame)
    place = subscription(camera)

    def send(now_s: float) -> int:
        camera.put(1)
        loop.drain()
        return len(list(place.take(now_s)))

    assert [send(now_s) for now_s in range(4)] == [1, 1, 0, 0]
    place.acknowledge(99)  # never sent
    assert send(5) == 0
    place.acknowledge(1)
    assert [send(now_s) for now_s in (6, 7)] == [1, 0]
    place.acknowledge(place.channel.seq)  # the newest was not sent yet
    assert send(8) == 0


def test_the_rate_is_kept_and_the_newest_goes_when_it_is_due(loop: Loop) -> None:
    camera = channel(loop, CAMERA, kept=1, decode=frame)
    place = subscription(camera, rate_hz=10.0)
    sent = []
    for tick in range(1000):
        camera.put(tick)
        loop.drain()
        for message in place.take(tick / 1000):
            assert isinstance(message, bytes)
            sent.append(LiveFrame.decode(message)[1][0] == tick % 256)
            place.acknowledge(camera.seq)
    assert 10 <= len(sent) <= 12
    assert all(sent)


def test_a_place_ahead_of_the_server_is_told_that_something_is_missing(loop: Loop) -> None:
    published = channel(loop)
    place = subscription(published, since=1000)
    assert place.due_s() == 0.0
    assert taken(place) == [("gap", None)]
    published.put(1)
    loop.drain()
    assert taken(place) == [("data", 1)]


def test_what_is_there_already_is_sent_at_once_or_not_as_asked(loop: Loop) -> None:
    published = channel(loop)
    for number in range(3):
        published.put(number)
    loop.drain()
    assert taken(subscription(published)) == []
    assert taken(subscription(published, since=0)) == [("data", 1), ("data", 2), ("data", 3)]
    assert taken(subscription(published, since=2)) == [("data", 3)]
    camera = channel(loop, CAMERA, kept=1, decode=frame)
    camera.put(1)
    loop.drain()
    assert len(list(subscription(camera).take(0.0))) == 1


def test_a_long_backlog_is_sent_without_waiting_and_in_parts(loop: Loop) -> None:
    published = channel(loop, kept=1000)
    for number in range(250):
        published.put(number)
    loop.drain()
    place = subscription(published, since=0)
    assert [len(taken(place, 0.0)) for _ in range(4)] == [100, 100, 50, 0]


def test_few_large_messages_are_kept_as_long_as_they_fit(loop: Loop) -> None:
    size = MAX_KEPT_BYTES // 4
    published = channel(loop, kept=100, decode=bytes)
    for _ in range(10):
        published.put(size)
        loop.drain()
    assert [item.seq for item in published.after(0, 100)] == [7, 8, 9, 10]
    published.put(2 * MAX_KEPT_BYTES)
    loop.drain()
    assert [item.seq for item in published.after(0, 100)] == [11]
    published.put(1)
    loop.drain()
    assert [item.seq for item in published.after(0, 100)] == [12]


def test_a_closed_loop_ends_nothing_but_the_view() -> None:
    loop = Loop()
    published = channel(loop)
    loop.close()
    for number in range(100):
        published.put(number)
    assert published.after(0, 100) == []
