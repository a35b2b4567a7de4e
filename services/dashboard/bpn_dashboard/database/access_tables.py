"""The tables of access: tokens, secrets, and what repeated requests have made."""

from sqlalchemy import ForeignKey, LargeBinary
from sqlalchemy.orm import Mapped, mapped_column

from bpn_dashboard.database.tables import Base


class TokenRow(Base):
    """A token for scripts, a browser's session, or a link that becomes one. The secret itself is not stored."""

    __tablename__ = "tokens"

    id: Mapped[str] = mapped_column(primary_key=True)
    kind: Mapped[str]
    """token, session or link"""
    name: Mapped[str]
    role: Mapped[str]
    sha256: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[float]
    last_used_at: Mapped[float | None]
    expires_at: Mapped[float | None]
    parent_id: Mapped[str | None] = mapped_column(
        ForeignKey("tokens.id", ondelete="CASCADE"), index=True
    )
    """Of the token or session that it was made from, and ends with."""


class SecretRow(Base):
    """A key of this dashboard's own."""

    __tablename__ = "secrets"

    name: Mapped[str] = mapped_column(primary_key=True)
    value: Mapped[bytes] = mapped_column(LargeBinary)


class IdempotencyRow(Base):
    """What a request with an Idempotency-Key made, so that repeating it makes nothing more."""

    __tablename__ = "idempotency"

    key: Mapped[str] = mapped_column(primary_key=True)
    """Of the actor, the operation and the header."""
    request_sha256: Mapped[str]
    subject: Mapped[str]
    """The id of what was made."""
    created_at: Mapped[float]
