"""Clients of the live view that are slow, wrong, unwelcome or many."""

import socket
from collections.abc import Callable
from typing import Any
from uuid import UUID

import psutil
import pytest
from live_view import CAMERA, OpenBus, Robot, Server, Tab, WaitFor, first_frame
from websockets.exceptions import InvalidStatus

from bpn_dashboard.hub import websocket
from bpn_dashboard.hub.websocket import PATH


def test_who_reads_nothing_costs_little_and_delays_nobody(
    server: Server, tab: Callable[..., Tab], open_bus: OpenBus, wait_for: WaitFor
) -> None:
    """12 channels of 84 x 84, 85 KB a frame, flooded: unbounded, memory would grow by far more."""
    stuck = socket.create_connection(("127.0.0.1", server.port))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf, lively = tab(sock=stuck, max_queue=1, ping_interval=None), tab()
    robot = Robot(open_bus(), channels=12)
    deaf.subscribe(CAMERA)
    deaf.subscribe("runs")
    camera = lively.subscribe(CAMERA)
    runs = lively.subscribe("runs")
    frame, _ = first_frame(lively, robot)
    before_bytes = psutil.Process().memory_info().rss
    last, frames, changes = 5000, 0, 0
    for number in range(1, last + 1):
        robot.show()
        if number % 5 == 0:
            server.view.publish("runs", {"id": number, "notes": "x" * 10_000})
        if number % 100 == 0:
            lively.say(op="ack", id=camera, seq=frame.seq)
            heard = lively.hear()
            while not isinstance(heard, tuple) or changes < number // 5 - 500:
                if isinstance(heard, tuple):
                    frame, frames = heard[0], frames + 1
                else:
                    assert (heard["op"], heard["id"]) == ("data", runs)  # none is missing
                    changes += 1
                heard = lively.hear()
            frame, frames = heard[0], frames + 1
    while changes < last // 5:
        heard = lively.hear()
        changes += not isinstance(heard, tuple)
    assert frames >= 45
    grown_bytes = psutil.Process().memory_info().rss - before_bytes
    assert grown_bytes < 40e6  # the flood was 425 MB
    stuck.close()
    wait_for(lambda: server.view.clients == 1, "the deaf client to be forgotten")


@pytest.mark.parametrize(
    ("message", "title"),
    [
        ({"op": "sub", "id": 5, "topic": "weather"}, "topic 'weather' is unknown"),
        ({"op": "sub", "id": 5, "topic": f"logs/{UUID(int=0)}"}, "no run 00000000"),
        ({"op": "sub", "id": 5, "topic": "runs", "rate_hz": -1}, "rate_hz"),
        ({"op": "hello", "proto": 1}, "hello comes once"),
        ({"op": "shout"}, "'shout'"),
    ],
)
def test_what_is_refused_says_why_and_the_connection_goes_on(
    tab: Callable[..., Tab], message: dict[str, Any], title: str
) -> None:
    page = tab()
    page.say(**message)
    error = page.hear()
    assert error["op"] == "error"
    assert title in error["title"]
    assert page.silent()


def test_an_id_is_one_subscription_and_there_is_a_limit(tab: Callable[..., Tab]) -> None:
    page = tab()
    page.say(op="sub", id=1, topic="runs")
    page.say(op="sub", id=1, topic="topology")
    assert "id 1 is in use" in page.hear()["title"]
    for number in range(2, 66):
        page.say(op="sub", id=number, topic="runs")
    assert page.hear() == {"op": "error", "id": 65, "title": "more than 64 subscriptions"}


def test_without_a_session_nothing_is_told(
    server: Server, tab: Callable[..., Tab], wait_for: WaitFor
) -> None:
    page = tab()
    page.subscribe("topology")
    server.owner = None
    assert page.closed_with() == websocket.CLOSE_NO_SESSION  # the session ended meanwhile
    stranger = tab(hello=False)
    assert stranger.closed_with() == websocket.CLOSE_NO_SESSION
    wait_for(lambda: server.view.clients == 0, "both to be forgotten")


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1", "http://evil.example"),
        ("127.0.0.1", "http://127.0.0.1:1"),
        ("127.0.0.1", "null"),
        ("127.0.0.1", None),
        ("evil.example", "http://evil.example:{port}"),
    ],
)
def test_other_sites_and_rebound_names_do_not_get_a_handshake(
    server: Server, tab: Callable[..., Tab], host: str, origin: str | None
) -> None:
    link = socket.create_connection(("127.0.0.1", server.port))
    given = None if origin is None else origin.format(port=server.port)
    with link, pytest.raises(InvalidStatus) as refused:
        tab(uri=f"ws://{host}:{server.port}{PATH}", origin=given, sock=link)
    assert refused.value.response.status_code == 403
    assert server.view.clients == 0


@pytest.mark.parametrize(
    "first",
    ['{"op":"sub","id":1,"topic":"runs"}', '{"op":"hello","proto":2}', "no json", b"binary"],
)
def test_whoever_does_not_speak_the_protocol_is_sent_away(
    tab: Callable[..., Tab], first: str | bytes
) -> None:
    page = tab(hello=False)
    page.socket.send(first)
    assert page.closed_with() == websocket.CLOSE_PROTOCOL


def test_errors_without_end_and_oversized_messages_end_the_connection(
    tab: Callable[..., Tab],
) -> None:
    page = tab()
    for _ in range(101):
        page.say(op="shout")
    assert page.closed_with() == websocket.CLOSE_PROTOCOL
    large = tab()
    large.socket.send("x" * 100_000)
    assert large.closed_with() == 1009


def test_there_is_room_for_a_hundred(
    server: Server, tab: Callable[..., Tab], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.hub.hub.MAX_CLIENTS", 2)
    tab(), tab()
    silent = [tab(hello=False) for _ in range(3)]  # they take no place
    assert server.view.clients == 2
    late = tab(hello=False)
    late.say(op="hello", proto=1)
    assert late.closed_with() == websocket.CLOSE_FULL
    assert server.counters.snapshot()["live_clients_refused"] == 1
    for each in silent:
        each.close()


def test_one_session_leaves_places_to_others(
    server: Server, tab: Callable[..., Tab], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn_dashboard.hub.hub.MAX_CLIENTS_OF_ONE", 2)
    tab(), tab()
    third = tab(hello=False)
    third.say(op="hello", proto=1)
    assert third.closed_with() == websocket.CLOSE_FULL
    server.owner = "somebody else"
    tab()
    assert server.view.clients == 3


def test_who_never_says_hello_is_sent_away(
    tab: Callable[..., Tab], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(websocket, "_HELLO_DEADLINE_S", 0.2)
    assert tab(hello=False).closed_with() == websocket.CLOSE_PROTOCOL
