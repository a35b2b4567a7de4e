"""Every metric's newest, highest and lowest value, and the means of its newest points, stand beside it.

The series are read again from the run folders, which fills them.
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

_COLUMNS = ("newest", "highest", "lowest", "mean_5", "mean_20", "mean_100")


def upgrade() -> None:
    for table in ("series_chunks", "series_metrics", "series_sources"):
        op.execute(f"DELETE FROM {table}")  # noqa: S608 - of the three above
    for name in _COLUMNS:
        op.add_column("series_metrics", sa.Column(name, sa.Double(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("series_metrics") as table:
        for name in _COLUMNS:
            table.drop_column(name)
