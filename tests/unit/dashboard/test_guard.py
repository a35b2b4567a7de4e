"""The guard by itself, around an application that only says that it was reached."""

import asyncio
import re

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request
from starlette.responses import PlainTextResponse

from bpn_dashboard.access.guard import Guard

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
