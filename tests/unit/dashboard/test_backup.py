"""A database of each older schema is copied before it is changed, or not changed."""

import errno
import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from disks import no_file_grows
from logged import lines
from sqlalchemy import create_engine

from bpn.cli import main
from bpn_dashboard.database import backup
from bpn_dashboard.database.backup import BackupError, back_up, backups
from bpn_dashboard.database.engine import MIGRATIONS, Database, DatabaseError, sqlite_url


def config() -> Config:
    found = Config()
    found.set_main_option("script_location", str(MIGRATIONS))
    return found


REVISIONS = [script.revision for script in ScriptDirectory.from_config(config()).walk_revisions()][
    ::-1
]
HEAD = REVISIONS[-1]


@pytest.fixture(scope="session")
def old_databases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """By revision, a file as the program of then left it, with an entry in its audit."""
    folder, found = tmp_path_factory.mktemp("old"), {}
    for revision in REVISIONS:
        found[revision] = folder / f"{revision}.sqlite"
        made, upgrade = create_engine(sqlite_url(found[revision])), config()
        with made.connect() as connection:
            upgrade.attributes["connection"] = connection
            command.upgrade(upgrade, revision)
            connection.exec_driver_sql(
                "INSERT INTO audit (at, actor, action, subject, detail) VALUES (1, ?, 'a', 's', '{}')",
                (revision,),
            )
            connection.commit()
        made.dispose()
    return found


@pytest.fixture
def old(tmp_path: Path, old_databases: dict[str, Path]) -> Callable[[str], Path]:
    def copy(revision: str) -> Path:
        return Path(shutil.copy(old_databases[revision], tmp_path / "db.sqlite"))

    return copy


def rows(file: Path, table: str, columns: str = "*") -> list[Any]:
    with closing(sqlite3.connect(file)) as connection:
        return connection.execute(f"SELECT {columns} FROM {table}").fetchall()


def schema(file: Path) -> list[Any]:
    return rows(file, "sqlite_master", "name, sql")


@pytest.mark.parametrize("revision", REVISIONS[:-1])
def test_it_is_copied_as_it_was_and_said(
    old, revision: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = old(revision)
    before = schema(file)
    Database(sqlite_url(file)).close()
    (copy,) = backups(file)
    assert copy.name.startswith(f"db.sqlite.{revision}-2")
    assert schema(copy) == before
    assert rows(copy, "audit", "actor") == rows(file, "audit", "actor") == [(revision,)]
    assert (rows(copy, "alembic_version"), rows(file, "alembic_version")) == (
        [(revision,)],
        [(HEAD,)],
    )
    assert copy.stat().st_mode & 0o777 == 0o600
    (said,) = lines(caplog, Database)
    assert f"schema {revision} becomes {HEAD}; as it was it is kept in {copy}" in said
    Database(sqlite_url(file)).close()
    assert backups(file) == [copy]  # nothing was migrated
    with sqlite3.connect(file) as newer:
        newer.execute("UPDATE alembic_version SET version_num = '9999'")
    newer.close()
    with pytest.raises(DatabaseError, match=rf"put {copy} in its place, or another database"):
        Database(sqlite_url(file))
    copy.rename(file)
    Database(sqlite_url(file)).close()
    assert rows(file, "audit", "actor") == [(revision,)]


@pytest.mark.parametrize("revision", REVISIONS[:-1])
def test_on_a_full_disk_it_is_neither_copied_nor_changed(
    old, tmp_path: Path, revision: str
) -> None:
    file = old(revision)
    before, size = schema(file), file.stat().st_size
    refused = pytest.raises(
        DatabaseError, match=r"cannot be made: .*\. Nothing was changed: make room for 1 MiB"
    )
    with no_file_grows(beyond_bytes=size - 4096), refused:
        Database(sqlite_url(file))
    assert backups(file) == []
    assert not list(tmp_path.glob("*.part"))
    assert rows(file, "alembic_version") == [(revision,)]
    assert schema(file) == before
    Database(sqlite_url(file)).close()
    assert rows(file, "alembic_version") == [(HEAD,)]


def test_room_for_all_but_the_copy(old, monkeypatch: pytest.MonkeyPatch) -> None:
    file = old(REVISIONS[0])

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(backup, "_bring_to_disk", full)
    with pytest.raises(
        DatabaseError, match=r"cannot be made: .*backup: No space left.*make room for 1 MiB"
    ):
        Database(sqlite_url(file))
    assert sorted(path.name for path in file.parent.glob("db.sqlite*backup*")) == []
    assert rows(file, "alembic_version") == [(REVISIONS[0],)]


def test_the_last_three_stay(old, monkeypatch: pytest.MonkeyPatch) -> None:
    file = old(HEAD)
    other = file.with_name("db.sqlite.notes.backup")
    other.touch()
    made = []
    for second in range(5):
        monkeypatch.setattr(backup.time, "strftime", lambda *_, s=second: f"20260101T00000{s}Z")
        made.append(back_up(file, f"000{5 - second}"))
    assert backups(file) == made[2:]
    assert other.exists()


def test_it_is_consistent_while_somebody_writes(old) -> None:
    file = old(HEAD)
    database = Database(sqlite_url(file))
    with database.writing() as session:
        session.connection().exec_driver_sql("DELETE FROM audit")
        copy = back_up(file, HEAD)
    assert rows(copy, "audit", "actor") == [(HEAD,)]
    assert rows(file, "audit", "actor") == []
    assert [path.name for path in file.parent.glob("*.backup*")] == [copy.name]
    database.close()


def test_what_is_no_database_is_not_copied(tmp_path: Path) -> None:
    (tmp_path / "db.sqlite").write_bytes(
        b"no database at all, and long enough to be looked at" * 50
    )
    with pytest.raises(BackupError, match="not a database"):
        back_up(tmp_path / "db.sqlite", "0001")
    assert backups(tmp_path / "db.sqlite") == []


def test_a_new_database_needs_no_copy(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    Database(sqlite_url(tmp_path / "db.sqlite")).close()
    assert backups(tmp_path / "db.sqlite") == []
    assert lines(caplog, Database) == []


def test_the_command_copies_a_database_in_use(tmp_path: Path, capsys: Any) -> None:
    assert main(["dashboard", "backup", "--runs-dir", str(tmp_path)]) == 2
    assert "there is no such database" in capsys.readouterr().err
    database = Database(sqlite_url(tmp_path / ".dashboard.sqlite"))
    assert main(["dashboard", "backup", "--runs-dir", str(tmp_path)]) == 0
    copy = Path(capsys.readouterr().out.strip())
    assert copy.name.startswith(f".dashboard.sqlite.{HEAD}-")
    assert schema(copy) == schema(tmp_path / ".dashboard.sqlite")
    database.close()
    (tmp_path / "x").write_bytes(b"x" * 5000)
    assert main(["dashboard", "backup", "--database", str(tmp_path / "x")]) == 1
    assert "not copied: file is not a database" in capsys.readouterr().err
