"""The tables of metric series. They can be rebuilt from the run folders."""

from sqlalchemy import BigInteger, ForeignKey, Index, LargeBinary
from sqlalchemy.orm import Mapped, mapped_column

from bpn_dashboard.database.tables import Base


class SourceRow(Base):
    """How far a run's metrics.jsonl has been read. Moves in the same transaction as what was read."""

    __tablename__ = "series_sources"

    run_id: Mapped[str] = mapped_column(primary_key=True)
    inode: Mapped[int] = mapped_column(BigInteger)
    """Of the file: another one is another file, and is read from the start."""
    offset_bytes: Mapped[int] = mapped_column(BigInteger)


class MetricRow(Base):
    """One metric of one run."""

    __tablename__ = "series_metrics"
    __table_args__ = (Index(None, "run_id", "name", unique=True),)

    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[str]
    name: Mapped[str]
    n: Mapped[int] = mapped_column(BigInteger)
    """Points, those that are NaN included."""
    first: Mapped[int] = mapped_column(BigInteger)
    """The smallest iteration."""
    last: Mapped[int] = mapped_column(BigInteger)
    """The largest iteration."""
    newest: Mapped[float | None]
    """The value of the largest iteration; None, as below: it is no number that can be stored."""
    highest: Mapped[float | None]
    lowest: Mapped[float | None]
    mean_5: Mapped[float | None]
    """Mean of the newest five points, or of all if there are fewer; None: one of them is NaN."""
    mean_20: Mapped[float | None]
    mean_100: Mapped[float | None]
    revision: Mapped[int] = mapped_column(BigInteger, index=True)
    """Grows with every change of any series, so the largest says whether something changed."""


class ChunkRow(Base):
    """The points of `series.store.CHUNK` consecutive iterations, of which some may have none.

    The rollup comes before the points: SQLite reads a row's bytes from the front, and a coarse view needs
    no more.
    """

    __tablename__ = "series_chunks"

    metric_id: Mapped[int] = mapped_column(
        ForeignKey(MetricRow.id, ondelete="CASCADE"), primary_key=True
    )
    part: Mapped[int] = mapped_column(BigInteger, primary_key=True)
    """iteration // CHUNK"""
    first: Mapped[int] = mapped_column(BigInteger)
    """The smallest iteration."""
    rollup: Mapped[bytes] = mapped_column(LargeBinary)
    """`Buckets.to_bytes`, each bucket `series.store.ROLLUP` iterations wide."""
    steps: Mapped[bytes | None] = mapped_column(LargeBinary)
    """int64 little-endian; None if they are first, first + 1, ..."""
    points: Mapped[bytes] = mapped_column(LargeBinary)
    """float64 little-endian, ascending in iteration."""
