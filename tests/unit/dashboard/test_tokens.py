"""Tokens, sessions and links: what makes, uses up and ends each of them, and nothing else."""

import time

import pytest

from bpn_dashboard.access import tokens as module
from bpn_dashboard.access.tokens import LINK_S, SESSION_S, Tokens, secret_key
from bpn_dashboard.database.access_tables import TokenRow
from bpn_dashboard.database.tables import AuditRow


@pytest.fixture
def tokens(database) -> Tokens:
    return Tokens(database)


def rows(database) -> dict[str, TokenRow]:
    with database.reading() as session:
        return {row.id: row for row in session.query(TokenRow)}


def test_making_one_ends_no_other_but_those_that_have_expired(tokens, database) -> None:
    secrets = [
        tokens.issue("token", f"t{i}", "viewer", lifetime_s=60 * (i + 1))[1] for i in range(3)
    ]
    forever = tokens.issue("token", "always", "viewer")[1]
    link = tokens.issue("link", "me", "operator", lifetime_s=60)[1]
    session = tokens.log_in(secrets[0])[1]
    gone, _ = tokens.issue("token", "old", "viewer", lifetime_s=-1)
    assert gone.id in rows(database)
    tokens.issue("token", "new", "viewer")
    assert gone.id not in rows(database)
    for secret in (*secrets, forever, session):
        assert tokens.identify(secret) is not None
    assert tokens.log_in(link) is not None


def test_a_session_makes_no_other_session(tokens) -> None:
    """Or a stolen one would never end."""
    _, token = tokens.issue("token", "ci", "operator")
    identity, session = tokens.log_in(token)
    assert identity.role == "operator"
    assert tokens.identify(session).role == "operator"
    assert tokens.log_in(session) is None


def test_a_link_is_used_up_and_a_token_is_not(tokens) -> None:
    _, link = tokens.issue("link", "me", "viewer", lifetime_s=60)
    _, token = tokens.issue("token", "ci", "viewer")
    assert [tokens.log_in(link) is not None for _ in range(2)] == [True, False]
    assert [tokens.log_in(token) is not None for _ in range(2)] == [True, True]


@pytest.mark.parametrize("kind", ["token", "link"])
def test_who_logged_in_by_what_is_written_down(tokens, database, kind: str) -> None:
    tokens.log_in(tokens.issue(kind, "me", "operator", lifetime_s=60)[1])
    with database.reading() as session:
        (entry,) = session.query(AuditRow).where(AuditRow.action == "log_in")
    (made,) = (row for row in rows(database).values() if row.kind == "session")
    assert (entry.actor, entry.subject) == ("me", made.id)
    assert entry.detail == {"role": "operator", "by": kind}


def test_sessions_and_links_end_when_they_should(tokens, database) -> None:
    now = time.time()
    tokens.log_in(tokens.issue("token", "ci", "viewer")[1])
    (session,) = (row for row in rows(database).values() if row.kind == "session")
    assert session.expires_at == pytest.approx(now + SESSION_S, abs=30)
    assert (SESSION_S, LINK_S) == (30 * 86_400, 86_400)


@pytest.mark.parametrize("use", ["identify", "log_in"])
def test_what_has_expired_lets_nobody_in(tokens, use: str) -> None:
    _, secret = tokens.issue("token", "ci", "admin", lifetime_s=-1)
    assert getattr(tokens, use)(secret) is None


def test_use_is_noted_at_most_once_a_minute(tokens, database, monkeypatch) -> None:
    row, secret = tokens.issue("token", "ci", "viewer")
    clock = time.time()
    for later_s, noted_s in ((0, 0), (30, 0), (61, 61)):
        monkeypatch.setattr(module.time, "time", lambda now=clock + later_s: now)
        tokens.identify(secret)
        assert rows(database)[row.id].last_used_at == clock + noted_s


def test_the_list_holds_what_is_valid_newest_first_links_too(tokens, monkeypatch) -> None:
    clock = time.time()
    monkeypatch.setattr(module.time, "time", lambda: clock)
    tokens.issue("token", "first", "viewer")
    tokens.issue("link", "link", "viewer", lifetime_s=60)
    monkeypatch.setattr(module.time, "time", lambda: clock + 1)
    tokens.issue("token", "second", "viewer", lifetime_s=60)
    assert [row.name for row in tokens.list()] == ["second", "first", "link"]
    monkeypatch.setattr(module.time, "time", lambda: clock + 62)
    assert [row.name for row in tokens.list()] == ["first"]


def test_only_one_of_the_asked_kinds_is_revoked(tokens) -> None:
    row, secret = tokens.issue("token", "ci", "viewer")
    assert not tokens.revoke(row.id, kinds=("session",))
    assert not tokens.revoke("nobody")
    assert tokens.identify(secret) is not None
    assert tokens.revoke(row.id)
    assert tokens.identify(secret) is None


def test_a_key_is_32_bytes_the_same_again_and_another_for_another_purpose(database) -> None:
    key = secret_key(database, "cookies")
    assert len(key) == 32
    assert secret_key(database, "cookies") == key
    assert secret_key(database, "other") != key
