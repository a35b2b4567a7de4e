"""Returns lose the unit in their names: a Gymnasium environment's has none."""

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


def downgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        for name in _COLUMNS:
            runs.alter_column(f"return_{name}", new_column_name=f"return_px_{name}")
