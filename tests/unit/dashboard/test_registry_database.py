import os
import sqlite3
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from sqlalchemy import create_engine
from sqlalchemy.exc import IntegrityError

from bpn_dashboard.database.engine import (
    MIGRATIONS,
    Database,
    DatabaseError,
    is_on_network,
    sqlite_url,
)
from bpn_dashboard.database.series_tables import ChunkRow
from bpn_dashboard.database.tables import AuditRow, Base
from bpn_dashboard.registry.store import RunStore
from bpn_shared.spec.config import RunConfig


def pragma(file: Path, name: str) -> object:
    with sqlite3.connect(file) as connection:
        return connection.execute(f"PRAGMA {name}").fetchone()[0]


def test_the_migrations_make_the_tables_that_the_code_has(tmp_path: Path) -> None:
    url = sqlite_url(tmp_path / "dashboard.sqlite")
    Database(url).close()
    with create_engine(url).connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    assert pragma(tmp_path / "dashboard.sqlite", "journal_mode") == "wal"
    Database(url).close()  # opening it again changes nothing


def test_what_is_known_of_runs_survives_older_schemas_and_back(tmp_path: Path) -> None:
    url = sqlite_url(tmp_path / "dashboard.sqlite")
    database = Database(url)
    run = RunStore(database, tmp_path / "runs").create(RunConfig.for_task("reaching"), actor="me")
    RunStore(database, tmp_path / "runs").observe({run.id: {"return_best": -3.5}})
    database.close()
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    engine = create_engine(url)
    with engine.connect() as connection:
        config.attributes["connection"] = connection
        command.downgrade(config, "0002")
        connection.commit()
        returns = connection.exec_driver_sql("SELECT return_px_best FROM runs").scalar_one()
    engine.dispose()
    assert returns == -3.5
    database = Database(url)
    assert RunStore(database, tmp_path / "runs").get(run.id).return_best == -3.5
    database.close()


def test_a_database_of_a_newer_program_is_refused_untouched(tmp_path: Path) -> None:
    file = tmp_path / "dashboard.sqlite"
    Database(sqlite_url(file)).close()
    with sqlite3.connect(file) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(DatabaseError, match=r"'9999', which this program does not know.*reindex"):
        Database(sqlite_url(file))


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("dashboard.sqlite", "no database that can be used"),
        ("oracle9://x", "no database that can be used"),
        ("sqlite://", "needs a file"),
        ("sqlite:////proc/dashboard.sqlite", "unable to open database file"),
    ],
)
def test_a_wrong_url_is_named(url: str, message: str) -> None:
    with pytest.raises(DatabaseError, match=message):
        Database(url)


def test_a_failed_writing_leaves_nothing(database: Database) -> None:
    def write_and_fail() -> None:
        with database.writing() as session:
            session.add(AuditRow(at=0.0, actor="a", action="b", subject="c", detail={}))
            session.flush()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_and_fail()
    with database.reading() as session:
        assert session.query(AuditRow).count() == 0


def test_foreign_keys_hold(database: Database) -> None:
    with pytest.raises(IntegrityError), database.writing() as session:
        session.add(ChunkRow(metric_id=7, part=0, first=0, rollup=b"", steps=None, points=b""))


def test_a_network_file_system_is_told_by_its_mount(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Part:
        def __init__(self, mountpoint: Path, fstype: str) -> None:
            self.mountpoint, self.fstype = str(mountpoint), fstype

    parts = [Part(Path("/"), "ext4"), Part(tmp_path, "nfs4"), Part(tmp_path / "local", "xfs")]
    monkeypatch.setattr("psutil.disk_partitions", lambda all: parts if all else [])
    assert is_on_network(tmp_path / "runs" / "dashboard.sqlite")
    assert not is_on_network(tmp_path / "local" / "dashboard.sqlite")
    assert not is_on_network(Path("/dashboard.sqlite"))
    Database(sqlite_url(tmp_path / "dashboard.sqlite")).close()
    assert pragma(tmp_path / "dashboard.sqlite", "journal_mode") == "delete"


def test_the_database_is_its_users_alone(tmp_path: Path) -> None:
    file = tmp_path / "state" / "dashboard.sqlite"
    file.parent.mkdir()
    old_mask = os.umask(0o022)
    try:
        for _ in range(2):
            database = Database(sqlite_url(file))
            with database.writing() as session:
                session.connection().exec_driver_sql("CREATE TABLE IF NOT EXISTS t (x)")
            modes = {path.name: path.stat().st_mode & 0o777 for path in file.parent.iterdir()}
            assert {f"{file.name}{end}" for end in ("", "-wal", "-shm")} == set(modes)
            assert set(modes.values()) == {0o600}
            database.close()
            file.chmod(0o644)  # as an earlier version left it
    finally:
        os.umask(old_mask)
