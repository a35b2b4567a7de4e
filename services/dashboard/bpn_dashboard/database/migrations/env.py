"""What Alembic runs: the migrations, on the connection that `Database` gives, in one transaction."""

from alembic import context

from bpn_dashboard.database import access_tables, series_tables  # noqa: F401 - into the metadata
from bpn_dashboard.database.tables import Base

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Base.metadata,
    render_as_batch=True,  # SQLite cannot alter a column in place
    transactional_ddl=True,
)
with context.begin_transaction():
    context.run_migrations()
