"""Why a run makes no progress, and since when."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        runs.add_column(sa.Column("waiting_reason", sa.String(), nullable=False, server_default=""))
        runs.add_column(sa.Column("waiting_since", sa.Double(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("runs") as runs:
        runs.drop_column("waiting_since")
        runs.drop_column("waiting_reason")
