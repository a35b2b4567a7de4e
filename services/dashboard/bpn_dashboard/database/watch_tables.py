"""The tables of what the dashboard saw happen: they are its own, and stand in no run folder."""

from sqlalchemy import BigInteger
from sqlalchemy.orm import Mapped, mapped_column

from bpn_dashboard.database.tables import Base


class SampleRow(Base):
    """How one service was at a moment."""

    __tablename__ = "service_samples"

    worker: Mapped[str] = mapped_column(primary_key=True)
    at: Mapped[int] = mapped_column(BigInteger, primary_key=True, index=True)
    """Unix seconds."""
    kind: Mapped[str]
    run: Mapped[str | None]
    slot: Mapped[int | None]
    host: Mapped[str]
    cpu_percent: Mapped[float | None]
    rss_bytes: Mapped[int | None] = mapped_column(BigInteger)
    messages_per_s: Mapped[float]
    """Sent and received."""
    dropped_per_s: Mapped[float]


class AlertRow(Base):
    """Something that somebody should hear of."""

    __tablename__ = "alerts"

    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[float]
    kind: Mapped[str]
    subject: Mapped[str]
    """The run or worker that it is about."""
    run: Mapped[str | None]
    text: Mapped[str]
