"""Idempotency-Key: a request that is sent again makes nothing twice."""

import hashlib
import time
from collections.abc import Callable
from typing import Annotated

from fastapi import Header
from pydantic import BaseModel
from sqlalchemy import delete

from bpn_dashboard.access.roles import Identity
from bpn_dashboard.api.problems import ApiError
from bpn_dashboard.database.access_tables import IdempotencyRow
from bpn_dashboard.database.engine import Database

IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=200,
        description="any text of your own; the same request with the same key is done once",
    ),
]

_REMEMBERED_S = 24 * 3600.0
_UNFINISHED_S = 120.0  # a robot worker may try an environment out first


def once(
    database: Database,
    who: Identity,
    operation: str,
    key: str | None,
    body: BaseModel,
    *,
    make: Callable[[], str],
) -> str:
    """Does what `make` does, once for each key of this user; without a key, always.

    Returns:
        The id of what was made, now or the first time.

    Raises:
        ApiError: the key belongs to another request, or the first one is not done yet.
    """
    if key is None:
        return make()
    name = _digest(f"{who.id}\n{operation}\n{key}")
    content = _digest(body.model_dump_json(exclude_unset=True))
    now = time.time()
    with database.writing() as session:
        session.execute(
            delete(IdempotencyRow).where(
                (IdempotencyRow.created_at < now - _REMEMBERED_S)
                | (
                    (IdempotencyRow.created_at < now - _UNFINISHED_S)
                    & (IdempotencyRow.subject == "")
                )
            )
        )
        known = session.get(IdempotencyRow, name)
        if known is None:
            session.add(
                IdempotencyRow(key=name, request_sha256=content, subject="", created_at=now)
            )
    if known is None:
        return _made(database, name, make)
    if known.request_sha256 != content:
        raise ApiError(422, "idempotency-key", "this Idempotency-Key belongs to another request")
    if not known.subject:
        raise ApiError(409, "in-progress", "the first request with this key is not done yet")
    return known.subject


def _made(database: Database, name: str, make: Callable[[], str]) -> str:
    subject = ""
    try:
        subject = make()
    finally:
        with database.writing() as session:
            row = session.get(IdempotencyRow, name)
            if row is not None and subject:
                row.subject = subject
            elif row is not None:
                session.delete(row)
    return subject


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()
