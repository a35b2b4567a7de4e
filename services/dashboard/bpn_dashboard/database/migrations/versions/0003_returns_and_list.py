"""Returns lose the unit in their names, for a Gymnasium environment has its own; an index as the list is read."""

from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_COLUMNS = ("last", "best", "mean_last_5")


def upgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        for name in _COLUMNS:
            runs.alter_column(f"return_px_{name}", new_column_name=f"return_{name}")
    op.drop_index(op.f("ix_runs_created_at_id"), "runs")
    op.create_index(
        op.f("ix_runs_archived_at_created_at_id"), "runs", ["archived_at", "created_at", "id"]
    )


def downgrade() -> None:
    op.drop_index(op.f("ix_runs_archived_at_created_at_id"), "runs")
    op.create_index(op.f("ix_runs_created_at_id"), "runs", ["created_at", "id"])
    with op.batch_alter_table("runs") as runs:
        for name in _COLUMNS:
            runs.alter_column(f"return_{name}", new_column_name=f"return_px_{name}")
