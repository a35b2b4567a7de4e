"""The guard by itself, around an application that only says that it was reached."""

import asyncio
import re
import socket

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request
from starlette.responses import PlainTextResponse

from bpn_dashboard.access.connections import Connections
from bpn_dashboard.access.guard import Guard
from bpn_shared.counters import Counters

LIMIT = 100


async def reached(scope, receive, send) -> None:
    request = Request(scope, receive)
    told = {"x-own": request.state.request_id, "cache-control": "max-age=5"}
    if request.url.path == "/api/plain":
        del told["cache-control"]
    await PlainTextResponse("reached", headers=told)(scope, receive, send)


@pytest.fixture
def client() -> TestClient:
    return TestClient(Guard(reached, max_body_bytes=LIMIT), base_url="http://localhost")


@pytest.mark.parametrize("given", ["", "a-1", "x" * 65, "a b", "a;b", "a\tb", "ä", "a/../b"])
def test_request_ids_are_the_servers_own(client, given: str) -> None:
    """It ends up in logs."""
    answer = client.get("/", headers={"X-Request-Id": given.encode()})
    assert re.fullmatch("[0-9a-f]{32}", answer.headers["x-request-id"])
    assert answer.headers["x-own"] == answer.headers["x-request-id"]
    again = client.get("/", headers={"X-Request-Id": given.encode()})
    assert again.headers["x-request-id"] != answer.headers["x-request-id"]


def test_what_is_no_request_passes_as_it_is() -> None:
    """The server's word that it begins and ends."""
    passed = []

    async def application(*arguments) -> None:
        passed.append(arguments)

    async def receive() -> None: ...

    async def send(_message) -> None: ...

    scope = {"type": "lifespan"}
    asyncio.run(Guard(application)(scope, receive, send))
    assert passed == [(scope, receive, send)]


def test_a_connection_waits_for_a_request_only_before_one_and_after_its_answer() -> None:
    """Who waits is ended first when there are too many."""
    connections = Connections(Counters())
    ours, theirs = socket.socketpair()
    peer = ("10.0.0.1", 5000)
    connection = connections.admit(ours, peer)
    assert connection is not None
    waits: list[bool] = []

    def look() -> None:
        waits.append(peer in connections._waiting_s)

    async def application(_scope, receive, send) -> None:
        for _ in range(2):
            await receive()
            look()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        look()
        await send({"type": "http.response.body", "body": b"x", "more_body": True})
        look()
        await send({"type": "http.response.body", "body": b""})
        look()

    parts = iter([True, False])

    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": b"x", "more_body": next(parts)}

    async def send(_message) -> None: ...

    scope = {"type": "http", "method": "GET", "path": "/", "client": peer,
             "headers": [(b"host", b"localhost"), (b"content-length", b"2")]}  # fmt: skip
    look()
    asyncio.run(Guard(application, connections=connections)(scope, receive, send))
    assert waits == [True, True, False, False, False, True]
    connection.close()
    theirs.close()


@pytest.mark.parametrize(("size", "status"), [(0, 200), (LIMIT, 200), (LIMIT + 1, 413)])
def test_a_body_over_the_limit_does_not_reach_the_application(client, size, status) -> None:
    answer = client.post("/", content=b"x" * size)
    assert answer.status_code == status
    if status == 413:
        assert f"the limit is {LIMIT} bytes" in answer.json()["detail"]
        assert answer.headers["x-frame-options"] == "DENY"


def test_a_length_that_is_no_number_is_left_to_the_server(client) -> None:
    assert client.get("/", headers={"Content-Length": "-1"}).status_code == 200


def test_what_the_application_says_of_caching_stands(client) -> None:
    assert client.get("/api/x").headers["cache-control"] == "max-age=5"
    assert client.get("/api/plain").headers["cache-control"] == "no-store"


def test_names_of_loopback_are_known_and_others_must_be_told() -> None:
    open_to = TestClient(Guard(reached, ["Robots.example"]), base_url="http://localhost")
    for host, status in (("robots.EXAMPLE:80", 200), ("[::1]:1", 200), ("robots.example.org", 421)):
        assert open_to.get("/", headers={"Host": host}).status_code == status
