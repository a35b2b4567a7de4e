"""Runs that are removed, brought back and deleted for good: the folder by the trash, the row behind it."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy.exc import OperationalError

from bpn_dashboard.database import audit
from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.errors import RunBusyError, RunStateError, UnknownRunError
from bpn_dashboard.registry.folders import name_in_trash, named_contents, row_of
from bpn_dashboard.registry.index import forget
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.retention import Rule
from bpn_dashboard.registry.states import is_idle
from bpn_dashboard.registry.store import RunStore
from bpn_shared.errors import one_line
from bpn_shared.runs.lock import RunOwnedError
from bpn_shared.runs.opening import folder_names, is_run_id
from bpn_shared.runs.trash import NotThereError, OccupiedError, Removed, Trash
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)

TIDY_S = 600.0
"""How often the trash is looked through, and the rule applied."""


@dataclass(frozen=True)
class Tidied:
    """What became of a run of many; `trouble` says why nothing did."""

    run: str
    name: str
    trouble: Exception | None = None


class Removals:
    """Its methods may be called from any thread. Folders are the truth: rows follow when the database lets them.

    Args:
        trash: of the store's runs directory.
    """

    def __init__(self, database: Database, store: RunStore, trash: Trash) -> None:
        self._database, self._store, self._trash = database, store, trash

    def remove(self, run_id: str, actor: str) -> Removed:
        """Moves a run to the trash.

        Raises:
            UnknownRunError: there is none of that id, or no longer; the message says where it is.
            RunBusyError: somebody works on it, or will.
            RunStateError: one of its id is in the trash.
            OSError: it cannot be moved; it is where it was.
        """
        self._store.check_writable()
        removed: Removed | None = None
        index = self._store.index
        with index.making:
            try:
                # In the transaction, so that nobody lets workers go on with it meanwhile.
                with self._database.writing() as session:
                    self._check_idle(run_id)
                    removed = self._put(run_id, actor)
                    forget(session, [run_id])
                    audit.record(session, actor, "remove", run_id)
            except OperationalError as error:
                if removed is None:
                    raise
                log.warning("the row of removed run %s stays for now: %s", run_id, error.orig)
                index.gone |= {run_id}
        self._store.audience.tell_gone([run_id])
        return removed

    def _check_idle(self, run_id: str) -> None:
        try:
            row = self._store.get(run_id)
        except UnknownRunError as error:
            if is_run_id(run_id) and run_id in folder_names(self._store.runs_dir):
                return  # it cannot be read, and no worker gets it
            if (removed := self._trash.find(run_id)) is None:
                raise
            raise UnknownRunError(
                run_id, f"run {run_id} is in the trash, {_by(removed)}"
            ) from error
        if not is_idle(row.state):
            raise RunBusyError(
                f"run {run_id} is {row.state}: stop it before removing it (`bpn runs stop {run_id}`)"
            )

    def _put(self, run_id: str, actor: str) -> Removed:
        try:
            return self._trash.put(run_id, actor)
        except NotThereError as error:
            raise UnknownRunError(run_id, str(error)) from error
        except (RunOwnedError, ConfigError) as error:  # the latter: its lock cannot be looked at
            raise RunBusyError(str(error)) from error
        except OccupiedError as error:
            raise RunStateError(str(error)) from error

    def restore(self, run_id: str, actor: str) -> RunRow:
        """Brings a run back from the trash, as it was.

        Raises:
            UnknownRunError: it is not in the trash, or no longer; the message says where it is.
            RunStateError: there is one of its id again.
            ConfigError: it is back, and cannot be read; the message says why.
            OSError: it cannot be moved; it is where it was.
        """
        self._store.check_writable()
        with self._store.index.making:
            try:
                self._trash.restore(run_id)
            except NotThereError as error:
                raise UnknownRunError(run_id, str(error)) from error
            except OccupiedError as error:
                raise RunStateError(str(error)) from error
        self._note(actor, "restore", run_id)
        try:
            self._store.adopt()
            return self._store.get(run_id)
        except (OperationalError, UnknownRunError):  # its row comes when the database takes it
            return row_of(self._store.folder(run_id))

    def name_of(self, removed: Removed) -> str:
        """What a removed run is called."""
        return name_in_trash(self._trash, removed.run)

    def contents(self) -> list[tuple[Removed, str]]:
        """What is in the trash, those removed last first, each with its name."""
        return named_contents(self._trash)

    def delete(self, run_id: str, actor: str) -> None:
        """Deletes a removed run for good.

        Raises:
            UnknownRunError: it is not in the trash, or no longer.
            OSError: not all of it can be deleted; it is tried again when the trash is next looked through.
        """
        self._store.check_writable()
        try:
            self._trash.delete(run_id)
        except NotThereError as error:
            raise UnknownRunError(run_id, str(error)) from error
        self._note(actor, "delete", run_id)

    def empty(self, actor: str, *, expired_only: bool = False) -> list[Tidied]:
        """Deletes for good what is in the trash, or what is no longer kept; what cannot be is told of each."""
        self._store.check_writable()
        now_s = time.time()
        deleted = [
            self._each(removed.run, name, lambda run: self.delete(run, actor))
            for removed, name in self.contents()
            if not expired_only or removed.until_unix_s <= now_s
        ]
        try:
            self._trash.sweep_up()
        except OSError as error:
            log.warning("a deletion is not finished: %s", one_line(error))
        return deleted

    def prune(self, rule: Rule, actor: str, *, dry_run: bool = False) -> list[Tidied]:
        """Moves to the trash what a rule takes away; what cannot be is told of each.

        Args:
            dry_run: only tells what it would be.

        Raises:
            ConfigError: the rule is none.
        """
        rule.check()
        self._store.check_writable()
        act: Callable[[str], object] = lambda run: dry_run or self.remove(run, actor)  # noqa: E731
        outdated = rule.outdated(self._store.find(RunFilter(archived=None)), time.time())
        return [self._each(row.id, row.name, act) for row in outdated]

    def _each(self, run_id: str, name: str, act: Callable[[str], object]) -> Tidied:
        try:
            act(run_id)
        except (UnknownRunError, RunBusyError, RunStateError, OSError, OperationalError) as trouble:
            return Tidied(run_id, name, trouble)
        return Tidied(run_id, name)

    def _note(self, actor: str, action: str, run_id: str) -> None:
        try:
            with self._database.writing() as session:
                audit.record(session, actor, action, run_id)
        except OperationalError as error:
            log.warning(
                "%s: %s of run %s is not in the audit: %s", actor, action, run_id, error.orig
            )


def keep_tidy(removals: Removals, rule: Rule | None, stop: threading.Event) -> None:
    """Applies the rule, and empties the trash of what is no longer kept, now and then until `stop` is set."""
    while not stop.wait(TIDY_S):
        try:
            done = [] if rule is None else removals.prune(rule, audit.OURSELVES)
            done += removals.empty(audit.OURSELVES, expired_only=True)
        except Exception as error:  # as of another dashboard that serves; the next time may do
            log.info("runs are not tidied up now: %s", error)
            continue
        for one in done:
            if one.trouble is not None:
                log.warning("run %s is not tidied up: %s", one.run, one.trouble)


def _by(removed: Removed) -> str:
    ago_s = max(0.0, time.time() - removed.at_unix_s)
    by = f"removed by {removed.by}" if removed.by else "removed"
    return f"{by} {ago_s:.0f} s ago: `bpn runs restore {removed.run}` brings it back"
