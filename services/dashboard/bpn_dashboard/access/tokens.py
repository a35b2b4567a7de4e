"""Tokens for scripts, sessions of browsers, and the links that become sessions.

All three are 256 random bits of which only the SHA-256 is stored: who reads the database cannot log in. What was
made from another one ends with it: when that is revoked, and no later than that expires.
"""

import hashlib
import secrets
import threading
import time
from collections.abc import Sequence
from typing import Literal, cast, get_args

import uuid_utils
from sqlalchemy import Select, delete, select
from sqlalchemy.orm import Session

from bpn_dashboard.access.roles import Identity, Role
from bpn_dashboard.database import audit
from bpn_dashboard.database.access_tables import SecretRow, TokenRow
from bpn_dashboard.database.engine import Database

Kind = Literal["token", "session", "link"]
KINDS: tuple[Kind, ...] = get_args(Kind)

SESSION_S = 30 * 86_400.0
LINK_S = 24 * 3600.0
_PREFIX = "bpn_"  # secret scanners find it
_USED_EVERY_S = 60.0
_MAX_CHARACTERS = 200


class RevokedError(RuntimeError):
    """Who asks was logged out or revoked meanwhile."""


class Tokens:
    """All that lets somebody in. Its methods may be called from any thread."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._of_process: dict[str, TokenRow] = {}  # by digest

    def issue(
        self,
        kind: Kind,
        name: str,
        role: Role,
        *,
        lifetime_s: float | None = None,
        parent: Identity | None = None,
        actor: str = audit.OURSELVES,
    ) -> tuple[TokenRow, str]:
        """A new one; its secret is the second value, and cannot be had again.

        Args:
            parent: with whom it ends; None, or a token of this process: it stands for itself.

        Raises:
            RevokedError: the parent is none any more.
        """
        row, secret = _new(kind, name, role, lifetime_s)
        with self._database.writing() as session:
            session.execute(delete(TokenRow).where(TokenRow.expires_at < time.time()))
            if parent is not None and not self._is_of_process(parent.id):
                _bind(row, _alive(session, parent.id))
            session.add(row)
            audit.record(session, actor, f"create_{kind}", row.id, name=name, role=role)
        return row, secret

    def issue_for_process(self, name: str, role: Role) -> tuple[TokenRow, str]:
        """A token that is good while this process lives: it is not stored, so nothing of it outlives a kill."""
        row, secret = _new("token", name, role, None)
        with self._database.writing() as session:
            audit.record(session, audit.OURSELVES, "create_token", row.id, name=name, role=role)
        with self._lock:
            self._of_process[row.sha256] = row
        return row, secret

    def identify(self, secret: str) -> Identity | None:
        """Who has this token or session; None if there is none, or it has expired."""
        now = time.time()
        with self._lock:
            own = self._of_process.get(_digest(secret))
        if own is not None:
            own.last_used_at = now
            return _identity(own)
        with self._database.reading() as session:
            row = session.scalar(_matching(secret, now).where(TokenRow.kind != "link"))
        if row is None:
            return None
        if row.last_used_at is None or now - row.last_used_at > _USED_EVERY_S:
            with self._database.writing() as session:
                if (stored := session.get(TokenRow, row.id)) is not None:
                    stored.last_used_at = now
        return _identity(row)

    def log_in(self, secret: str) -> tuple[Identity, str] | None:
        """Makes a session from a link, which is used up by it, or from a token; None if it is neither.

        Returns:
            Who it is, and the session's secret.
        """
        with self._database.writing() as session:
            found = session.scalar(_matching(secret, time.time()).where(TokenRow.kind != "session"))
            if found is None:
                return None
            row, session_secret = _new("session", found.name, cast(Role, found.role), SESSION_S)
            if found.kind == "token":
                _bind(row, found)
            else:
                if found.parent_id is not None:
                    _bind(row, _alive(session, found.parent_id))
                session.delete(found)
            session.add(row)
            audit.record(session, row.name, "log_in", row.id, role=row.role, by=found.kind)
        return _identity(row), session_secret

    def list(self) -> list[TokenRow]:
        """Every token, session and link that is good now, newest first."""
        alive = (TokenRow.expires_at.is_(None)) | (TokenRow.expires_at > time.time())
        with self._database.reading() as session:
            stored = list(session.scalars(select(TokenRow).where(alive)))
        with self._lock:
            rows = [*stored, *self._of_process.values()]
        return sorted(rows, key=lambda row: row.created_at, reverse=True)

    def revoke(
        self, token_id: str, kinds: Sequence[Kind] = KINDS, *, actor: str = audit.OURSELVES
    ) -> bool:
        """Makes one of these kinds, and all that was made from it, worthless from now on.

        Returns:
            Whether there was one of that id.
        """
        with self._lock:
            own = [digest for digest, row in self._of_process.items() if row.id == token_id]
            rows = [self._of_process.pop(digest) for digest in own if "token" in kinds]
        with self._database.writing() as session:
            if not rows:
                row = session.get(TokenRow, token_id)
                if row is None or row.kind not in kinds:
                    return False
                session.delete(row)  # and the database those that have it as parent
                rows = [row]
            for row in rows:
                detail = {"name": row.name, "role": row.role}
                audit.record(session, actor, f"revoke_{row.kind}", row.id, **detail)
        return True

    def _is_of_process(self, token_id: str) -> bool:
        with self._lock:
            return any(row.id == token_id for row in self._of_process.values())


def secret_key(database: Database, name: str) -> bytes:
    """32 random bytes for a purpose, the same whenever this database is opened."""
    with database.writing() as session:
        row = session.get(SecretRow, name)
        if row is None:
            row = SecretRow(name=name, value=secrets.token_bytes(32))
            session.add(row)
        return row.value


def _matching(secret: str, now: float) -> Select[TokenRow]:
    alive = (TokenRow.expires_at.is_(None)) | (TokenRow.expires_at > now)
    return select(TokenRow).where(TokenRow.sha256 == _digest(secret), alive)


def _alive(session: Session, token_id: str) -> TokenRow:
    row = session.get(TokenRow, token_id)
    if row is None:
        raise RevokedError("your session or token has ended meanwhile; log in again")
    return row


def _bind(row: TokenRow, parent: TokenRow) -> None:
    """Lets it end with its parent."""
    row.parent_id = parent.id
    if parent.expires_at is not None:
        row.expires_at = min(row.expires_at or parent.expires_at, parent.expires_at)


def _new(kind: Kind, name: str, role: Role, lifetime_s: float | None) -> tuple[TokenRow, str]:
    secret = _PREFIX + secrets.token_urlsafe(32)
    now = time.time()
    row = TokenRow(
        id=str(uuid_utils.uuid7()), kind=kind, name=name, role=role, sha256=_digest(secret),
        created_at=now, last_used_at=None, parent_id=None,
        expires_at=None if lifetime_s is None else now + lifetime_s,
    )  # fmt: skip
    return row, secret


def _digest(secret: str) -> str:
    return hashlib.sha256(secret[:_MAX_CHARACTERS].encode("utf-8", "replace")).hexdigest()


def _identity(row: TokenRow) -> Identity:
    return Identity(row.id, row.name, cast(Role, row.role), row.parent_id)
