"""Runs know the name of their return: tasks are plug-ins, whose names tell nothing."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # What was known of tasks until here.
    with op.batch_alter_table("runs") as runs:
        runs.add_column(
            sa.Column("return_metric", sa.String(), nullable=False, server_default="return_px")
        )
    op.execute("UPDATE runs SET return_metric = 'return' WHERE task LIKE 'gym:%'")
    with op.batch_alter_table("runs") as runs:
        runs.alter_column("return_metric", server_default=None)


def downgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        runs.drop_column("return_metric")
