"""The tables. Run folders are the truth; what stands here can be rebuilt from them.

Times are Unix seconds. A `config` is a `RunConfig` as JSON.
"""

from typing import Any

from sqlalchemy import JSON, BigInteger, ForeignKey, Index, MetaData, event
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from bpn_dashboard.database.text_keys import order_key, search_text
from bpn_shared.spec.tasks import RETURN


class Base(DeclarativeBase):
    """What all tables share. Constraints have names so that later migrations can change them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {  # noqa: RUF012 - as SQLAlchemy wants it
        dict[str, Any]: JSON,
        dict[str, list[Any]]: JSON,
        list[str]: JSON,
        list[int]: JSON,
    }


class SweepRow(Base):
    """A grid over configuration keys, times seeds; its runs name it."""

    __tablename__ = "sweeps"

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    config: Mapped[dict[str, Any]]
    """The task, and what is changed from its preset in every run."""
    grid: Mapped[dict[str, list[Any]]]
    seeds: Mapped[list[int]]
    created_at: Mapped[float]


class RunRow(Base):
    """A run: what was asked for, and what was last seen of it.

    `rev` counts the changes that people make (name, notes, tags, archived, wanted or not), not what the
    run itself does: who edits a running run's notes must not collide with its progress.
    """

    __tablename__ = "runs"
    __table_args__ = (
        Index(None, "archived_at", "created_at", "id"),  # what the list of runs shows first
        Index(None, "state"),
        Index(None, "sweep_id"),
        Index(None, "name_order"),
    )

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    name_order: Mapped[str] = mapped_column(default="", server_default="")
    """`order_key` of the name."""
    search_text: Mapped[str] = mapped_column(default="", server_default="")
    """`text_keys.search_text`."""
    task: Mapped[str]
    algorithm: Mapped[str]
    seed: Mapped[int] = mapped_column(BigInteger)
    config: Mapped[dict[str, Any]]
    """Its values; of task and algorithm the names alone: the specifications are in the run's folder."""
    config_hash: Mapped[str]
    """`runs.config_file.config_hash`, of what is learned alone. Empty: the row is made anew from its folder."""

    state: Mapped[str]
    desired_state: Mapped[str]
    attempt: Mapped[int]
    iteration: Mapped[int]
    """Iterations done."""
    iterations: Mapped[int]
    weights_version: Mapped[int | None]
    return_metric: Mapped[str] = mapped_column(default=RETURN)
    """Name of the mean return among the run's metrics, which tells its unit."""
    return_last: Mapped[float | None]
    """Mean return of the newest iteration, as of the next two in the unit of the run's return metric."""
    return_best: Mapped[float | None]
    return_mean_last_5: Mapped[float | None]
    length_last: Mapped[float | None]
    error: Mapped[str]
    waiting_reason: Mapped[str] = mapped_column(default="", server_default="")
    """Why it makes no progress though it shall; empty if it does."""
    waiting_since: Mapped[float | None]

    notes: Mapped[str]
    tags: Mapped[list[str]]
    sweep_id: Mapped[str | None] = mapped_column(ForeignKey(SweepRow.id))
    archived_at: Mapped[float | None]
    priority: Mapped[int] = mapped_column(default=0, server_default="0")
    """Of those that wait for workers the highest is served first, and of equal ones the oldest."""
    created_at: Mapped[float]
    updated_at: Mapped[float]
    rev: Mapped[int]
    folder_at: Mapped[float | None]
    """When its state had been written, as the file system had it when the row was made from the folder."""
    disk_bytes: Mapped[int | None] = mapped_column(BigInteger)
    """Of its folder; None: not measured yet."""


@event.listens_for(RunRow, "before_insert")
@event.listens_for(RunRow, "before_update")
def _derive(_mapper: Any, _connection: Any, row: RunRow) -> None:
    row.name_order = order_key(row.name)
    row.search_text = search_text(run_id=row.id, name=row.name, notes=row.notes, tags=row.tags)


class AuditRow(Base):
    """Who asked for what, and when."""

    __tablename__ = "audit"

    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[float]
    actor: Mapped[str]
    action: Mapped[str]
    subject: Mapped[str] = mapped_column(index=True)
    """The id of the run, sweep or token."""
    detail: Mapped[dict[str, Any]]
