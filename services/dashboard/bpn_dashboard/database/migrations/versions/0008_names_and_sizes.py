"""Runs are searched and ordered by their names as people mean them, and know how large their folders are."""

import re
import unicodedata

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

_RUNS = sa.table(
    "runs", sa.column("id"), sa.column("name"), sa.column("notes"), sa.column("tags", sa.JSON),
    sa.column("name_order"), sa.column("search_text"),
)  # fmt: skip


def upgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        for name in ("name_order", "search_text"):
            runs.add_column(sa.Column(name, sa.String(), nullable=False, server_default=""))
        runs.add_column(sa.Column("folder_at", sa.Double(), nullable=True))
        runs.add_column(sa.Column("disk_bytes", sa.BigInteger(), nullable=True))
        runs.create_index(runs.f("ix_runs_name_order"), ["name_order"])
    connection = op.get_bind()
    for run in connection.execute(sa.select(_RUNS)).all():
        words = _folded("\n".join((run.name, run.notes, *run.tags, run.id)))
        connection.execute(
            sa.update(_RUNS)
            .where(_RUNS.c.id == run.id)
            .values(name_order=_order(run.name), search_text=words)
        )


def downgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        runs.drop_index(runs.f("ix_runs_name_order"))
        for name in ("disk_bytes", "folder_at", "search_text", "name_order"):
            runs.drop_column(name)


# As the program of this schema has them (database/text_keys.py): a later one may differ, and migrates again.


def _folded(text: str) -> str:
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())


def _order(name: str) -> str:
    plain = "".join(
        c for c in unicodedata.normalize("NFKD", _folded(name)) if not unicodedata.combining(c)
    )
    return re.sub(r"\d+", lambda digits: _sortable(digits[0]), plain)


def _sortable(digits: str) -> str:
    significant = digits.lstrip("0")
    return f"{len(significant):03d}{significant}"
