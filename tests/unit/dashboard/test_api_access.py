"""Who gets in, from where, and what each role may do."""

import contextlib
import re
import time

import pytest
from fastapi.routing import iter_route_contexts
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import update
from starlette.websockets import WebSocketDisconnect

from bpn_dashboard.access.guard import CONTENT_SECURITY_POLICY, Guard
from bpn_dashboard.access.roles import ROLES
from bpn_dashboard.access.tokens import RevokedError
from bpn_dashboard.api.app import create_app
from bpn_dashboard.api.context import Context
from bpn_dashboard.api.openapi import ROLE
from bpn_dashboard.database.access_tables import TokenRow
from bpn_dashboard.database.engine import Database, sqlite_url

PUBLIC = {"logIn", "getHealth", "getReadiness", "getPrometheusMetrics"}  # the last checks by itself


def operations(application):
    for path, methods in application.api.openapi()["paths"].items():
        for method, operation in methods.items():
            yield method.upper(), re.sub(r"{[^}]*}", "0", path), operation


def test_every_operation_needs_a_role_but_for_the_named_ones(application) -> None:
    found = {op["operationId"]: op.get(ROLE) for _, _, op in operations(application)}
    assert {name for name, role in found.items() if role is None} == PUBLIC
    assert set(found.values()) == {None, *ROLES}


def test_every_route_is_described(application) -> None:
    described = set(application.api.openapi()["paths"])
    served = {route.path for route in iter_route_contexts(application.api.routes)}
    assert served - described == {"/{path:path}"}


def test_each_role_may_do_what_it_and_lower_ones_may(application, client_of) -> None:
    """A role that is high enough never gets 401 or 403; a lower one gets 403, nobody 401."""
    clients = {role: client_of(role) for role in (None, *ROLES)}
    checked = 0
    for method, path, operation in operations(application):
        needed = operation.get(ROLE)
        for role, client in clients.items():
            if operation["operationId"] in PUBLIC | {"logOut"}:
                continue
            status = client.request(method, path).status_code
            if role is None:
                assert status == 401, (method, path)
            elif ROLES.index(role) < ROLES.index(needed):
                assert status == 403, (method, path, role)
            else:
                assert status not in (401, 403, 500), (method, path, role)
            checked += 1
    assert checked > 100


def test_metrics_need_a_token_unless_opened_to_loopback(application, client_of, context) -> None:
    assert client_of(None).get("/metrics").status_code == 401
    shown = client_of("viewer").get("/metrics")
    assert shown.status_code == 200
    assert "process_resident_memory_bytes" in shown.text
    context.open_metrics = True
    local = TestClient(application, base_url="http://localhost", client=("127.0.0.1", 9))
    distant = TestClient(application, base_url="http://localhost", client=("10.0.0.7", 9))
    assert (local.get("/metrics").status_code, distant.get("/metrics").status_code) == (200, 401)


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost:8000", 200), ("127.0.0.1", 200), ("[::1]:8000", 200), ("dashboard.example", 200),
        ("DASHBOARD.example:1", 200), ("evil.example", 421), ("localhost.evil.example", 421),
        ("", 421), ("[", 421), ("10.0.0.1", 421), ("localhost@evil.example", 421),
        ("evil.com@localhost", 421), ("localhost/evil", 421), ("localhost#x", 421), ("localhost:abc", 421),
        ("localhost:8591:evil", 421), ("[::1", 421), ("::1", 421), ("localhost:", 421), ("localhost?", 421),
        ("LOCALHOST", 200), ("localhost:999999", 421),
    ],
)  # fmt: skip
def test_only_known_hosts_are_served(client, host, status) -> None:
    answer = client.get("/api/v1/runs", headers={"Host": host})
    assert answer.status_code == status
    assert answer.headers["content-security-policy"] == CONTENT_SECURITY_POLICY


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        ({}, True),
        ({"Origin": "http://localhost:8000"}, True),
        ({"Origin": "https://localhost:8000"}, True),  # a proxy ended TLS
        ({"Origin": "http://localhost:9000"}, False),
        ({"Origin": "http://evil.example"}, False),
        ({"Origin": "null"}, False),
        ({"Origin": "http://[::1"}, False),
        ({"Origin": ""}, False),
        ({"Origin": "http://localhost:8000@evil.example"}, False),
        ({"Origin": "http://localhost:8000.evil.example"}, False),
        ({"Origin": "file://localhost:8000"}, False),
        ({"Sec-Fetch-Site": "same-origin"}, True),
        ({"Sec-Fetch-Site": "none"}, True),
        ({"Sec-Fetch-Site": "same-site"}, False),
        ({"Sec-Fetch-Site": "cross-site"}, False),
        ({"Sec-Fetch-Site": "cross-site", "Origin": "http://localhost:8000"}, False),
    ],
)
def test_changes_come_from_our_own_pages(client, headers, allowed) -> None:
    answer = client.post("/api/v1/runs", json={"config": {"task": "reaching"}}, headers=headers)
    assert answer.status_code == (201 if allowed else 403)
    assert client.get("/api/v1/runs", headers=headers).status_code == 200


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        ({"Origin": "http://localhost"}, True),
        ({"Authorization": "Bearer x"}, True),
        ({}, False),
        ({"Origin": "http://evil.example"}, False),
        ({"Origin": "http://localhost", "Host": "evil.example"}, False),
        ({"Origin": "http://evil.example", "Host": "evil.example"}, False),
        ({"Origin": "http://evil.example", "Authorization": "Bearer x"}, False),
        ({"Origin": "http://localhost", "Sec-Fetch-Site": "cross-site"}, False),
    ],
)
def test_web_sockets_come_from_our_own_pages(headers, allowed) -> None:
    url = "ws://localhost/api/v1/live"

    async def accept(_scope, receive, send) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        await send({"type": "websocket.close"})

    client = TestClient(Guard(accept))
    expectation = contextlib.nullcontext() if allowed else pytest.raises(WebSocketDisconnect)
    with expectation as refusal, client.websocket_connect(url, headers=headers):
        pass
    assert allowed or refusal.value.code == 4403


def test_each_of_several_origins_must_be_ours(client) -> None:
    ours, other = b"http://localhost:8000", b"http://evil.example"
    for origins in ((ours, other), (other, ours)):
        headers = [(b"origin", origin) for origin in origins]
        answer = client.post("/api/v1/runs", json={"config": {"task": "reaching"}}, headers=headers)
        assert answer.status_code == 403


def test_ids_of_requests_are_the_servers_own(client) -> None:
    asked = "id-of-somebody-elses-request"
    answer = client.get("/api/v1/runs/unknown", headers={"X-Request-Id": asked})
    assert answer.headers["x-request-id"] != asked
    assert answer.json()["request_id"] == answer.headers["x-request-id"]


def test_a_link_becomes_a_session_once(client_of, context) -> None:
    _, link = context.tokens.issue("link", "me", "operator", lifetime_s=60)
    browser, other = client_of(None), client_of(None)
    answer = browser.post("/api/v1/session", json={"token": link})
    assert answer.status_code == 204
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "Path=/" in cookie
    assert browser.get("/api/v1/session").json() == {"name": "me", "role": "operator"}
    refused = other.post("/api/v1/session", json={"token": link})
    assert refused.status_code == 401
    assert refused.json()["type"] == "urn:bpn:problem:wrong-token"
    assert browser.delete("/api/v1/session").status_code == 204
    assert browser.get("/api/v1/session").status_code == 401
    done = client_of("admin").get("/api/v1/audit").json()["items"]
    own = [item["action"] for item in done if item["actor"] == "me"]
    assert own == ["revoke_session", "log_in"]


def test_a_link_is_no_token_and_an_expired_token_none_either(client_of, context) -> None:
    _, link = context.tokens.issue("link", "me", "admin", lifetime_s=60)
    _, expired = context.tokens.issue("token", "me", "admin", lifetime_s=-1)
    for secret in (link, expired, "", "x" * 5000, "\xff"):
        assert context.tokens.identify(secret) is None
    client = client_of(None)
    assert (
        client.get("/api/v1/runs", headers={"Authorization": f"Bearer {link}"}).status_code == 401
    )


def test_sessions_outlive_the_process_and_secrets_are_not_stored(context, database) -> None:
    _, link = context.tokens.issue("link", "me", "viewer", lifetime_s=60)
    _, session = context.tokens.log_in(link)
    again = Context(database, context.runs, context.ingest, context.counters)
    assert again.tokens.identify(session).role == "viewer"
    with database.reading() as reading:
        rows = str(reading.connection().exec_driver_sql("SELECT * FROM tokens").fetchall())
    assert session not in rows
    assert session.removeprefix("bpn_") not in rows


def test_tokens_are_made_listed_and_revoked(client, client_of) -> None:
    made = client.post("/api/v1/tokens", json={"name": "ci", "role": "viewer", "lifetime_s": 3600})
    assert made.status_code == 201
    token = made.json()["token"]
    script = client_of(None)
    script.headers["Authorization"] = f"Bearer {token}"
    assert script.get("/api/v1/runs").status_code == 200
    listed = client.get("/api/v1/tokens").json()["items"]
    assert made.json()["id"] in [item["id"] for item in listed]
    assert token not in str(listed)
    assert client.delete(f"/api/v1/tokens/{made.json()['id']}").status_code == 204
    assert script.get("/api/v1/runs").status_code == 401
    assert client.delete(f"/api/v1/tokens/{made.json()['id']}").status_code == 404
    done = client.get("/api/v1/audit", params={"subject": made.json()["id"]}).json()["items"]
    assert [(item["actor"], item["action"], item["detail"]) for item in done] == [
        ("admin", f"{action}_token", {"name": "ci", "role": "viewer"})
        for action in ("revoke", "create")
    ]


def test_nobody_makes_a_link_for_more_than_their_role(client_of) -> None:
    operator = client_of("operator")
    assert operator.post("/api/v1/links", json={"role": "admin"}).status_code == 403
    link = operator.post("/api/v1/links", json={"role": "viewer"}).json()["token"]
    browser = client_of(None)
    assert browser.post("/api/v1/session", json={"token": link}).status_code == 204
    assert browser.get("/api/v1/session").json()["role"] == "viewer"


def client_at(application, address: str) -> TestClient:
    return TestClient(application, base_url="http://localhost", client=(address, 9))


def test_guessing_is_slowed_down_and_nobody_else_is(application, context) -> None:
    """Behind a proxy all have one address: who has a right secret there is served, whatever others try."""
    _, link = context.tokens.issue("link", "me", "viewer", lifetime_s=60)
    _, token = context.tokens.issue("token", "script", "viewer")
    guesser = client_at(application, "10.0.0.7")
    wrong = [
        guesser.post("/api/v1/session", json={"token": f"x{i}"}).status_code for i in range(25)
    ]
    assert wrong == [401] * 20 + [429] * 5
    refused = guesser.get("/api/v1/runs", headers={"Authorization": "Bearer x"})
    assert refused.status_code == 429
    assert int(refused.headers["retry-after"]) > 0
    neighbour = client_at(application, "10.0.0.7")
    right = {"Authorization": f"Bearer {token}"}
    assert neighbour.get("/api/v1/runs", headers=right).status_code == 200
    assert neighbour.get("/metrics", headers=right).status_code == 200
    assert neighbour.post("/api/v1/session", json={"token": link}).status_code == 204
    assert neighbour.get("/api/v1/runs").status_code == 200


def test_a_cookie_that_has_ended_is_no_guess(application, context) -> None:
    browser = client_at(application, "10.0.0.7")
    browser.cookies.set(context.cookie, "bpn_of-an-older-day")
    assert {browser.get("/api/v1/runs").status_code for _ in range(30)} == {401}
    _, link = context.tokens.issue("link", "me", "viewer", lifetime_s=60)
    assert browser.post("/api/v1/session", json={"token": link}).status_code == 204
    assert browser.get("/api/v1/runs").status_code == 200


def test_two_dashboards_on_one_host_do_not_meet_in_the_browser(
    application, context, tmp_path
) -> None:
    """Cookies know no port: both get both."""
    others = Database(sqlite_url(tmp_path / "other.sqlite"))
    other = Context(others, context.runs, context.ingest, context.counters)
    browser = client_at(application, "127.0.0.1")
    for dashboard in (context, other):
        _, link = dashboard.tokens.issue("link", "me", "viewer", lifetime_s=60)
        client = client_at(create_app(dashboard), "127.0.0.1")
        answer = client.post("/api/v1/session", json={"token": link})
        browser.cookies.update(answer.cookies)
    assert browser.get("/api/v1/session").status_code == 200
    second = client_at(create_app(other), "127.0.0.1")
    second.cookies = browser.cookies
    assert second.get("/api/v1/session").status_code == 200
    assert Context(others, context.runs, context.ingest, context.counters).cookie == other.cookie
    others.close()


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    ways=st.lists(st.sampled_from(("session", "link")), min_size=1, max_size=4),
    revoked=st.integers(0, 4),
)
def test_revoking_ends_all_that_was_made_from_it_and_nothing_else(context, ways, revoked) -> None:
    """A chain of tokens, links and sessions, each made from the one before; one of them is revoked."""
    tokens = context.tokens
    row, secret = tokens.issue("token", "first", "operator", lifetime_s=3600)
    _, bystander = tokens.issue("token", "bystander", "viewer")
    chain = [(row.id, secret)]
    for way in ways:
        parent = tokens.identify(chain[-1][1])
        if way == "session" and parent.parent_id is None:
            who, secret = tokens.log_in(chain[-1][1])
        else:
            _, link = tokens.issue("link", "x", "operator", lifetime_s=86_400, parent=parent)
            who, secret = tokens.log_in(link)
        chain.append((who.id, secret))
    listed = {row.id: row for row in tokens.list()}
    for token_id, _ in chain:
        assert listed[token_id].expires_at <= row.expires_at
    end = min(revoked, len(chain) - 1)
    assert tokens.revoke(chain[end][0])
    alive = [tokens.identify(secret) is not None for _, secret in chain]
    assert alive == [index < end for index in range(len(chain))]
    assert tokens.identify(bystander) is not None


def test_an_expired_token_ends_its_sessions_and_links(context) -> None:
    parent_row, secret = context.tokens.issue("token", "ci", "operator", lifetime_s=60)
    parent = context.tokens.identify(secret)
    _, session = context.tokens.log_in(secret)
    link_row, link = context.tokens.issue("link", "ci", "viewer", lifetime_s=3600, parent=parent)
    assert link_row.expires_at == parent_row.expires_at
    with context.database.writing() as writing:
        writing.execute(update(TokenRow).values(expires_at=time.time() - 1))
    assert context.tokens.identify(session) is None
    assert context.tokens.log_in(link) is None


def test_an_admin_sees_and_revokes_links_and_sessions(client, client_of, context) -> None:
    operator = client_of("operator")
    token = operator.headers["Authorization"].removeprefix("Bearer ")
    link = operator.post("/api/v1/links", json={"role": "viewer"}).json()["token"]
    browser = client_of(None)
    assert browser.post("/api/v1/session", json={"token": token}).status_code == 204
    made = context.tokens.identify(token).id
    listed = {item["kind"]: item for item in client.get("/api/v1/tokens").json()["items"]
              if item["parent_id"] == made}  # fmt: skip
    assert set(listed) == {"link", "session"}
    assert client.delete(f"/api/v1/tokens/{listed['link']['id']}").status_code == 204
    assert client_of(None).post("/api/v1/session", json={"token": link}).status_code == 401
    assert browser.get("/api/v1/session").status_code == 200
    assert client.delete(f"/api/v1/tokens/{made}").status_code == 204
    assert browser.get("/api/v1/session").status_code == 401
    refused = operator.post("/api/v1/links", json={"role": "viewer"})
    assert refused.status_code == 401


def test_who_is_revoked_while_asking_makes_nothing(context) -> None:
    row, secret = context.tokens.issue("token", "ci", "operator")
    who = context.tokens.identify(secret)
    context.tokens.revoke(row.id)
    with pytest.raises(RevokedError):
        context.tokens.issue("link", "ci", "viewer", lifetime_s=60, parent=who)


def test_a_token_of_the_process_is_not_stored_and_ends_when_told(context, client) -> None:
    row, secret = context.tokens.issue_for_process("local commands", "operator")
    again = Context(context.database, context.runs, context.ingest, context.counters)
    assert context.tokens.identify(secret).role == "operator"
    assert again.tokens.identify(secret) is None
    assert again.tokens.log_in(secret) is None
    assert row.id in [item["id"] for item in client.get("/api/v1/tokens").json()["items"]]
    _, link = context.tokens.issue(
        "link", "local", "viewer", lifetime_s=60, parent=context.tokens.identify(secret)
    )
    assert client.delete(f"/api/v1/tokens/{row.id}").status_code == 204
    assert context.tokens.identify(secret) is None
    assert client.delete(f"/api/v1/tokens/{row.id}").status_code == 404
    assert context.tokens.log_in(link) is not None  # the user's own, as the printed one
