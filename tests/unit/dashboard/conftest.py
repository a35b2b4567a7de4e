import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from bpn_dashboard.access.roles import Role
from bpn_dashboard.api.app import Application, create_app
from bpn_dashboard.api.context import Context
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.database.tables import Base
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series.ingest import Ingest
from bpn_shared.counters import Counters


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with all tables, to copy: making them takes longer than most tests."""
    file = tmp_path_factory.mktemp("database") / "empty.sqlite"
    Database(sqlite_url(file)).close()
    return file


@pytest.fixture
def database(tmp_path: Path, empty_database: Path) -> Iterator[Database]:
    """A SQLite file; where BPN_TEST_DATABASE names another database, that one, emptied."""
    shutil.copy(empty_database, tmp_path / "dashboard.sqlite")
    url = os.environ.get("BPN_TEST_DATABASE")
    database = Database(url or sqlite_url(tmp_path / "dashboard.sqlite"))
    with database.writing() as session:
        for table in reversed(Base.metadata.sorted_tables) if url else ():
            session.execute(table.delete())
    yield database
    database.close()


@pytest.fixture
def store(database: Database, tmp_path: Path) -> RunStore:
    return RunStore(database, tmp_path / "runs")


@pytest.fixture
def context(database: Database, store: RunStore) -> Context:
    counters = Counters()
    return Context(database, store, Ingest(store.runs_dir, database, counters), counters)


@pytest.fixture
def application(context: Context) -> Application:
    return create_app(context, hosts=["dashboard.example"])


@pytest.fixture
def client_of(application: Application, context: Context) -> Callable[[Role | None], TestClient]:
    """A client with a token of that role, or none; server errors are answers, as for real clients."""

    def client(role: Role | None) -> TestClient:
        headers = {}
        if role is not None:
            headers["Authorization"] = f"Bearer {context.tokens.issue('token', role, role)[1]}"
        return TestClient(
            application,
            base_url="http://localhost:8000",
            headers=headers,
            raise_server_exceptions=False,
        )

    return client


@pytest.fixture
def client(client_of: Callable[[Role | None], TestClient]) -> TestClient:
    """May do everything."""
    return client_of("admin")
