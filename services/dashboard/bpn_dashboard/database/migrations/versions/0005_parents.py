"""Sessions and links know what made them, and end with it."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Whose sessions and links are was not written down: people open a new link. And what earlier processes made
    # for the local user's commands was good for a year, however they ended.
    op.execute(
        "DELETE FROM tokens WHERE kind <> 'token' OR id IN "
        "(SELECT subject FROM audit WHERE actor = 'bpn-dashboard' AND action = 'create_token')"
    )
    with op.batch_alter_table("tokens") as tokens:
        tokens.add_column(sa.Column("parent_id", sa.String(), nullable=True))
        tokens.create_foreign_key(
            op.f("fk_tokens_parent_id_tokens"), "tokens", ["parent_id"], ["id"], ondelete="CASCADE"
        )
    op.create_index(op.f("ix_tokens_parent_id"), "tokens", ["parent_id"])


def downgrade() -> None:
    op.drop_index(op.f("ix_tokens_parent_id"), "tokens")
    with op.batch_alter_table("tokens") as tokens:
        tokens.drop_constraint(op.f("fk_tokens_parent_id_tokens"), type_="foreignkey")
        tokens.drop_column("parent_id")
