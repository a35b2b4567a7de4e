"""`bpn dashboard`: care of the dashboard's database."""

import argparse
import sqlite3
import sys
from collections.abc import Sequence
from pathlib import Path

from bpn.dashboard import Dashboard
from bpn.errors import CommandError
from bpn.options import add_runs_dir
from bpn_dashboard.database.backup import KEPT, BackupError, back_up, schema_of
from bpn_dashboard.database.engine import Database, DatabaseError
from bpn_dashboard.options import DATABASE_FILE, database_url
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.state_lock import state_lock
from bpn_shared.errors import InputError


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    action = actions.add_parser(
        "reindex",
        help="rebuild the database from the run folders",
        description="Makes the database say what the run folders say, which are the truth. Tokens stay.",
    )
    add_runs_dir(action)
    action.add_argument("--database", metavar="URL", help="as the dashboard's own option")
    action.set_defaults(run=reindex)
    action = actions.add_parser(
        "backup",
        help="copy the database, while a dashboard uses it too",
        description="Copies the SQLite database beside it, as is done before a migration; the last "
        f"{KEPT} copies stay. To restore one, stop the dashboard, delete the database with its -wal and -shm, and "
        "rename the copy.",
    )
    add_runs_dir(action)
    action.add_argument(
        "--database", metavar="FILE", type=Path, help="default: the one in the runs folder"
    )
    action.set_defaults(run=backup)


def reindex(options: argparse.Namespace) -> int:
    """Rebuilds; exit status 1 if a folder could not be read.

    Raises:
        InputError: a dashboard is running on these runs, or the database cannot be used.
    """
    running = Dashboard.find(options.runs_dir)
    if running is not None:
        raise InputError(f"the dashboard at {running.url} uses the database: stop it first")
    if not options.runs_dir.is_dir():
        raise InputError(f"--runs-dir {options.runs_dir}: there is no such folder")
    with state_lock(options.runs_dir):
        try:
            database = Database(database_url(options.runs_dir, options.database))
        except DatabaseError as error:
            raise InputError(str(error)) from error
        result = RunStore(database, options.runs_dir).index.rebuild()
        database.close()
    print(f"{result.runs} runs and {result.sweeps} sweeps indexed, {result.removed} removed")
    for reason in result.damaged:
        print(f"left out: {reason}", file=sys.stderr)
    return 1 if result.damaged else 0


def backup(options: argparse.Namespace) -> int:
    """Copies the database, and prints where to.

    Raises:
        InputError: there is none.
        CommandError: it cannot be copied.
    """
    file: Path = options.database or options.runs_dir / DATABASE_FILE
    if not file.is_file():
        raise InputError(f"{file}: there is no such database; --database names another file")
    try:
        print(back_up(file, schema_of(file)))
    except (BackupError, sqlite3.Error) as error:
        raise CommandError(f"the database is not copied: {error}") from error
    return 0
