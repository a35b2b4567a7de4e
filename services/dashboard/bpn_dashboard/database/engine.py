"""One database: SQLite in write-ahead mode by default, or whatever a SQLAlchemy URL names."""

import logging
import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, OperationalError
from sqlalchemy.exc import DatabaseError as SQLAlchemyDatabaseError
from sqlalchemy.orm import Session
from sqlalchemy.pool import ConnectionPoolEntry

from bpn_dashboard.database.backup import BackupError, back_up, backups

log = logging.getLogger(__name__)

MIGRATIONS = Path(__file__).with_name("migrations")

_BUSY_TIMEOUT_MS = 5000
_NETWORK_FILE_SYSTEMS = (
    "9p", "afs", "ceph", "cifs", "fuse.", "glusterfs", "gpfs", "lustre", "nfs", "smb",
)  # fmt: skip
_BEGIN = "sqlite_begin"
_REMEDY = (
    "stop the dashboard, delete the file with its -wal and -shm, and start it again: the run folders have all "
    "but tokens and the audit (or delete it and run `bpn dashboard reindex`)"
)


class DatabaseError(RuntimeError):
    """The database cannot be used; the message says why and what to do."""


class Database:
    """Sessions for reading, from any number of threads, and for writing, one at a time.

    Objects that a session has loaded stay readable after it ends.

    Args:
        url: a SQLAlchemy URL; for SQLite a file's, such as `sqlite:////data/dashboard.sqlite`.

    Raises:
        DatabaseError: the URL is wrong, the database cannot be opened, a newer program wrote it, or an older one
            did and it cannot be copied before it is changed.
    """

    def __init__(self, url: str) -> None:
        try:
            self._engine = create_engine(url, **_options(make_url(url)))
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError) as error:
            raise DatabaseError(
                f"{url!r} is no database that can be used: {error}. "
                "An example of one: sqlite:////data/dashboard.sqlite"
            ) from error
        self._writer = threading.Lock()
        if self._engine.dialect.name == "sqlite":
            _configure_sqlite(self._engine)
        with self.explained():
            self._check()
            self._upgrade()

    def __str__(self) -> str:
        return f"the database {self._engine.url.render_as_string(hide_password=True)}"

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session that sees one consistent state."""
        with Session(self._engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """The one session that may write; commits at the end, and nothing of it if the body raises."""
        with self._writer, self._engine.connect() as connection:
            # the lock from the beginning: one that is upgraded later can fail where others write too
            connection.execution_options(**{_BEGIN: "BEGIN IMMEDIATE"})
            with Session(connection, expire_on_commit=False) as session, session.begin():
                yield session
            connection.commit()

    def close(self) -> None:
        self._engine.dispose()

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Makes what the database cannot do in the body an error that says what people can.

        Raises:
            DatabaseError: the database cannot be opened, or is damaged.
        """
        try:
            yield
        except OperationalError as error:
            raise DatabaseError(f"{self}: {error.orig}") from error
        except (SQLAlchemyDatabaseError, sqlite3.DatabaseError) as error:
            reason = getattr(error, "orig", error)
            raise DatabaseError(f"{self} is damaged ({reason}): {_REMEDY}") from error

    def _check(self) -> None:
        """Looks for damage that would only be met later.

        Raises:
            DatabaseError: SQLite has found some.
        """
        if self._engine.dialect.name != "sqlite":
            return
        with self._engine.connect() as connection:
            found = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
        if found != "ok":
            reason = " ".join(str(found).split())
            raise DatabaseError(f"{self} is damaged ({reason}): {_REMEDY}")

    def _upgrade(self) -> None:
        config = Config()
        config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
        scripts = ScriptDirectory.from_config(config)
        known = {script.revision for script in scripts.walk_revisions()}
        with self._engine.connect() as connection:
            if self._engine.dialect.name == "sqlite":
                # A changed table is copied and renamed, and its rows must not cascade away meanwhile.
                _pragma(connection, "foreign_keys = OFF")
            for revision in MigrationContext.configure(connection).get_current_heads():
                if revision not in known:
                    raise DatabaseError(
                        f"{self} has schema {revision!r}, which this program does not know: a newer one "
                        f"wrote it. Use that version, {self._copy_of(known)}or another database and "
                        "`bpn dashboard reindex`"
                    )
                if revision != (head := scripts.get_current_head()):
                    self._back_up(revision, str(head))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")
            connection.commit()
        self._engine.dispose()  # with its pragma

    def _back_up(self, before: str, after: str) -> None:
        """Keeps what the migrations change.

        Raises:
            DatabaseError: it cannot be copied; nothing was changed.
        """
        change = f"{self}: schema {before} becomes {after}"
        if self._engine.dialect.name != "sqlite":
            log.warning("%s; a server's database is not copied before", change)
            return
        path = Path(str(self._engine.url.database))
        try:
            copy = back_up(path, before)
        except BackupError as error:
            raise DatabaseError(
                f"{change} only with a copy from before, which cannot be made: {error}. Nothing was changed: make "
                f"room for {path.stat().st_size // 2**20 + 1} MiB"
            ) from error
        log.warning("%s; as it was it is kept in %s", change, copy)

    def _copy_of(self, known: set[str]) -> str:
        """Advice to put the newest copy in place that this program can read."""
        if self._engine.dialect.name == "sqlite":
            path = Path(str(self._engine.url.database))
            for copy in reversed(backups(path)):
                if copy.name.removeprefix(f"{path.name}.").split("-")[0] in known:
                    return f"put {copy} in its place, "
        return ""


def _options(url: URL) -> dict[str, Any]:
    """For a server: sessions that see one state throughout, and connections that outlive its restart."""
    if url.get_backend_name() == "sqlite":
        return {}
    return {"isolation_level": "REPEATABLE READ", "pool_pre_ping": True}


def _pragma(connection: Connection, statement: str) -> None:
    raw = connection.connection.driver_connection  # below SQLAlchemy's transaction
    assert isinstance(raw, sqlite3.Connection)
    raw.execute(f"PRAGMA {statement}")


def _configure_sqlite(engine: Engine) -> None:
    file = engine.url.database
    if not file or file == ":memory:":
        raise DatabaseError("SQLite needs a file, such as sqlite:////data/dashboard.sqlite")
    path = Path(file).resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    _make_private(path)
    journal = "DELETE" if is_on_network(path) else "WAL"  # WAL needs memory shared by all its users

    def connected(raw: sqlite3.Connection, _entry: ConnectionPoolEntry) -> None:
        raw.isolation_level = None  # transactions begin where SQLAlchemy says
        for pragma in (
            f"busy_timeout = {_BUSY_TIMEOUT_MS}",
            f"journal_mode = {journal}",
            "synchronous = NORMAL",
            "foreign_keys = ON",
        ):
            raw.execute(f"PRAGMA {pragma}")

    def begin(connection: Connection) -> None:
        connection.exec_driver_sql(connection.get_execution_options().get(_BEGIN, "BEGIN"))

    event.listen(engine, "connect", connected)
    event.listen(engine, "begin", begin)


def _make_private(path: Path) -> None:
    """Its user's alone, as the files that SQLite puts beside it then are: it holds keys and who did what."""
    with suppress(
        OSError
    ):  # SQLite says why it cannot be opened, and another user's is that user's to protect
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))
        path.chmod(0o600)
        for end in ("-wal", "-shm"):
            path.with_name(path.name + end).chmod(0o600)


def is_on_network(path: Path) -> bool:
    """Whether a file is, or would be, on a network file system."""
    mounts = {part.mountpoint: part.fstype for part in psutil.disk_partitions(all=True)}
    for folder in path.parents:
        if (kind := mounts.get(str(folder))) is not None:
            return str(kind).startswith(_NETWORK_FILE_SYSTEMS)
    return False


def sqlite_url(file: Path) -> str:
    """The URL of a SQLite file."""
    return make_url("sqlite://").set(database=str(file.absolute())).render_as_string()
