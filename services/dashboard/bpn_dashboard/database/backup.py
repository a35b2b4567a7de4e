"""Copies of a SQLite database, made before a migration changes it, beside it and as private as it is.

Tokens and audit are in the database alone; all else can be rebuilt from the run folders.
"""

import os
import re
import sqlite3
import time
from contextlib import closing, suppress
from pathlib import Path

from bpn_shared.runs.files import naming

KEPT = 3
"""Copies of one database; the oldest go."""


class BackupError(RuntimeError):
    """No copy could be made; the message says why. Nothing of one is left."""


def back_up(database: Path, version: str) -> Path:
    """Copies a database consistently, whoever uses it meanwhile; returns the copy, which is on disk then.

    Args:
        version: of its schema, for the copy's name.

    Raises:
        BackupError: it cannot be copied.
    """
    taken = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    copy = database.with_name(f"{database.name}.{version}-{taken}.backup")
    partial = copy.with_name(f"{copy.name}.part")
    try:
        with naming(copy):
            partial.unlink(missing_ok=True)
            os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
            _copy(database, partial)
            _bring_to_disk(partial)
            partial.replace(copy)
            _bring_to_disk(copy.parent)
    except (sqlite3.Error, OSError) as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise BackupError(f"{copy}: {reason}") from error
    for old in backups(database)[:-KEPT]:
        old.unlink(missing_ok=True)
    return copy


def backups(database: Path) -> list[Path]:
    """The copies of a database that are beside it, oldest first."""
    name = re.compile(re.escape(database.name) + r"\.[^.-]+-(\d{8}T\d{6}Z)\.backup")
    found = [
        (match[1], path)
        for path in database.parent.iterdir()
        if (match := name.fullmatch(path.name))
    ]
    return [path for _, path in sorted(found)]


def schema_of(database: Path) -> str:
    """The version of a database's schema, as its migrations wrote it.

    Raises:
        sqlite3.Error: it is no database of the dashboard.
    """
    with closing(sqlite3.connect(database)) as connection:
        found = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    return str(found[0]) if found else "empty"


def _copy(source: Path, target: Path) -> None:
    with closing(sqlite3.connect(source)) as read, closing(sqlite3.connect(target)) as written:
        read.backup(written)
        written.execute("PRAGMA journal_mode = DELETE")  # one file, without others beside it
        found = written.execute("PRAGMA quick_check(1)").fetchone()[0]
        if found != "ok":
            raise sqlite3.DatabaseError(f"the copy is not what it should be: {found}")


def _bring_to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
