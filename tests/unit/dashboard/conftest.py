from collections.abc import Iterator
from pathlib import Path

import pytest

from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.store import RunStore


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = Database(sqlite_url(tmp_path / "dashboard.sqlite"))
    yield database
    database.close()


@pytest.fixture
def store(database: Database, tmp_path: Path) -> RunStore:
    return RunStore(database, tmp_path / "runs")
