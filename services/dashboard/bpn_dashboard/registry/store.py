"""The runs: made, found, wanted or not wanted any more. Folder and database change together here."""

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import UUID

import uuid_utils
from sqlalchemy import select
from sqlalchemy.orm import Session

from bpn_dashboard.database import audit
from bpn_dashboard.database.engine import Database
from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.about import About, SweepFile
from bpn_dashboard.registry.audience import Audience
from bpn_dashboard.registry.errors import (
    ReadOnlyError,
    RunBusyError,
    RunStateError,
    StaleError,
    UnknownRunError,
    UnknownSweepError,
)
from bpn_dashboard.registry.folders import row_of, there
from bpn_dashboard.registry.index import Index
from bpn_dashboard.registry.observations import Changes, Observations, apply
from bpn_dashboard.registry.query import (
    Cursor,
    Page,
    RunFilter,
    conditions,
    find_page,
    states_of_sweeps,
)
from bpn_dashboard.registry.states import is_busy, is_idle
from bpn_dashboard.registry.sweeps import expand
from bpn_shared.runs.creation import Workplace
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.state import OVER
from bpn_shared.spec.config import RunConfig

WhyNot = Callable[[], str | None]


class RunStore:
    """All runs of one runs directory. Its methods may be called from any thread; rows are for reading.

    Changes by people name an `actor` for the audit.

    Args:
        runs_dir: where the run folders are.
        read_only: why people may change nothing now; None: they may. May wait until that is known.

    Attributes:
        audience: who hears of changes.
        index: the rows from the folders.
    """

    def __init__(
        self, database: Database, runs_dir: Path, read_only: WhyNot = lambda: None
    ) -> None:
        self._database, self._read_only = database, read_only
        self.runs_dir = runs_dir
        self.audience = Audience()
        self.index = Index(database, runs_dir)
        self._observations = Observations(database)

    def check_writable(self) -> None:
        """Nothing, or

        Raises:
            ReadOnlyError: another dashboard serves the router.
        """
        if (reason := self._read_only()) is not None:
            raise ReadOnlyError(reason)

    def folder(self, run_id: str) -> RunFolder:
        """The folder of a run, which has an id as the registry makes them."""
        return RunFolder(self.runs_dir / str(UUID(run_id)))

    # Runs: read

    def get(self, run_id: str) -> RunRow:
        """A run.

        Raises:
            UnknownRunError: there is none of that id.
        """
        with self._database.reading() as session:
            row = _run(session, run_id)
        if run_id in self.index.gone:
            raise UnknownRunError(run_id)
        return self._observations.shown([row])[0]

    def page(
        self,
        runs: RunFilter | None = None,
        *,
        sort: str = "created_at",
        descending: bool = True,
        after: Cursor | None = None,
        limit: int = 50,
    ) -> Page:
        """Some of the runs that meet a filter (by default those not archived), in order.

        Raises:
            FilterError: the filter, sort key or cursor is none; the message says which.
        """
        with self._database.reading() as session:
            page = find_page(
                session, self.of_those_there(runs),
                sort=sort, descending=descending, after=after, limit=limit,
            )  # fmt: skip
        return replace(page, rows=self._observations.shown(page.rows))

    def find(self, runs: RunFilter | None = None) -> list[RunRow]:
        """All runs that meet a filter, oldest first.

        Raises:
            FilterError: the filter is none; the message says why.
        """
        with self._database.reading() as session:
            where = conditions(self.of_those_there(runs))
            rows = list(session.scalars(select(RunRow).where(*where).order_by(RunRow.created_at)))
        return self._observations.shown(rows)

    def ids(self) -> frozenset[str]:
        """Of all runs that there are."""
        with self._database.reading() as session:
            return frozenset(session.scalars(select(RunRow.id))) - self.index.gone

    def of_those_there(self, runs: RunFilter | None) -> RunFilter:
        return replace(runs or RunFilter(), without=self.index.gone)

    # Runs: change

    def create(
        self,
        config: RunConfig,
        *,
        name: str = "",
        notes: str = "",
        tags: Sequence[str] = (),
        actor: str,
    ) -> RunRow:
        """A new run, in the queue for workers.

        Raises:
            ReadOnlyError: another dashboard serves the router.
            OSError: its folder cannot be made, as on a full disk; nothing of it is left.
        """
        self.check_writable()
        with self.index.making, ExitStack() as undo:
            row = self._new_run(undo, config, name=name, notes=notes, tags=tags, sweep_id=None)
            with self._database.writing() as session:
                session.add(row)
                audit.record(session, actor, "create", row.id, config=row.config)
            undo.pop_all()
        self.audience.tell([row])
        return row

    def _new_run(
        self,
        undo: ExitStack,
        config: RunConfig,
        *,
        name: str,
        notes: str = "",
        tags: Sequence[str] = (),
        sweep_id: str | None,
    ) -> RunRow:
        run_id = _new_id()
        undo.callback(shutil.rmtree, self.runs_dir / run_id, ignore_errors=True)
        folder = RunFolder.create(self.runs_dir, UUID(run_id), config)
        about = About(
            name=name, notes=notes, tags=list(tags), sweep_id=sweep_id, desired_state="running"
        )
        row = row_of(folder, about)
        About.write(folder, row)
        return row

    def update(
        self,
        run_id: str,
        rev: int,
        *,
        name: str | None = None,
        notes: str | None = None,
        tags: Sequence[str] | None = None,
        actor: str,
    ) -> RunRow:
        """Changes what people say about a run; None leaves it.

        Raises:
            UnknownRunError: there is none of that id.
            StaleError: it is no longer at `rev`.
        """
        given = {"name": name, "notes": notes, "tags": None if tags is None else list(tags)}
        changes = {key: value for key, value in given.items() if value is not None}

        def decide(row: RunRow) -> Changes:
            if row.rev != rev:
                raise StaleError(
                    f"run {run_id} is at revision {row.rev}, not {rev}: read it again and repeat"
                )
            return changes

        return self.edit(run_id, "update", actor, decide)

    def request_stop(self, run_id: str, actor: str) -> RunRow:
        """Nobody shall work on the run any more; whoever does is told to stop. Harmless if it is over.

        Raises:
            UnknownRunError: there is none of that id.
        """

        def decide(row: RunRow) -> Changes:
            if row.state in OVER:
                return {}
            state = "stopping" if is_busy(row.state) else "stopped"
            return {"desired_state": "stopped", "state": state}

        return self.edit(run_id, "stop", actor, decide)

    def request_resume(self, run_id: str, actor: str) -> RunRow:
        """Workers shall go on with the run from where its folder stands.

        Raises:
            UnknownRunError: there is none of that id.
            RunStateError: it has done all its iterations, or is archived.
        """

        def decide(row: RunRow) -> Changes:
            if row.state == "finished":
                raise RunStateError(f"run {run_id} is finished: all its iterations are done")
            if row.archived_at is not None:
                raise RunStateError(f"run {run_id} is archived: take it out of the archive first")
            if is_busy(row.state):
                return {"desired_state": "running"}
            self.folder(run_id).set_state("queued")
            return {"desired_state": "running", "state": "queued", "error": ""}

        return self.edit(run_id, "resume", actor, decide)

    def archive(self, run_id: str, actor: str) -> RunRow:
        """Takes the run out of sight; `unarchive` brings it back. Nothing is deleted.

        Raises:
            UnknownRunError: there is none of that id.
            RunBusyError: workers are on it, or will be.
        """

        def decide(row: RunRow) -> Changes:
            if not is_idle(row.state):
                raise RunBusyError(f"run {run_id} is {row.state}: stop it before archiving it")
            return {"archived_at": row.archived_at or time.time()}

        return self.edit(run_id, "archive", actor, decide)

    def unarchive(self, run_id: str, actor: str) -> RunRow:
        """Brings an archived run back.

        Raises:
            UnknownRunError: there is none of that id.
        """
        return self.edit(run_id, "unarchive", actor, lambda _row: {"archived_at": None})

    def edit(
        self, run_id: str, action: str, actor: str, decide: Callable[[RunRow], Changes]
    ) -> RunRow:
        """Makes the changes that `decide` finds for the row as it is now; nothing if it raises.

        Raises:
            UnknownRunError: there is none of that id.
            ReadOnlyError: another dashboard serves the router.
        """
        self.check_writable()
        with self._database.writing() as session, there(run_id):
            row = _run(session, run_id)
            changes = decide(row)
            if not apply(row, changes):
                return row
            row.rev += 1
            audit.record(session, actor, action, run_id, **changes)
            About.write(self.folder(run_id), row)
        self.audience.tell([row])
        return row

    def observe(self, observations: Mapping[str, Changes]) -> list[RunRow]:
        """Stores what was seen of runs (id to columns); returns the rows that it changed."""
        changed = self._observations.write(observations)
        self.audience.tell(changed)
        return changed

    def adopt(self) -> None:
        """Makes rows for folders that have none, of runs that other programs made, and drops those without one."""
        self._observations.retry()
        self.audience.tell(self.index.adopt())
        self.audience.tell_gone(self.index.drop_vanished())

    def changed_folders(self) -> list[RunRow]:
        """The runs whose folders' state was written since last time, by whomever."""
        with self._database.reading() as session:
            ids = self.index.changed(session)
            return list(session.scalars(select(RunRow).where(RunRow.id.in_(ids)))) if ids else []

    # Sweeps

    def create_sweep(
        self,
        name: str,
        config: Mapping[str, Any],
        grid: Mapping[str, Sequence[Any]],
        seeds: Sequence[int],
        *,
        actor: str,
        place: Workplace,
    ) -> SweepRow:
        """A sweep and all its runs.

        Args:
            config: the task, and what is changed from its preset in every run.
            place: where the runs will be done.

        Raises:
            ConfigError: a key or value of configuration or grid is wrong; nothing was made.
            OSError: a folder cannot be made, as on a full disk; nothing of the sweep is left.
        """
        self.check_writable()
        runs = expand(config, grid, seeds, place)
        sweep = SweepRow(
            id=_new_id(), name=name, config=dict(config), seeds=list(seeds), created_at=time.time(),
            grid={key: list(values) for key, values in grid.items()},
        )  # fmt: skip
        with self.index.making, ExitStack() as undo:
            undo.callback(SweepFile.path(self.runs_dir, sweep.id).unlink, missing_ok=True)
            SweepFile.write(self.runs_dir, sweep)
            rows = [
                self._new_run(undo, run.config, name=run.name, sweep_id=sweep.id) for run in runs
            ]
            with self._database.writing() as session:
                session.add(sweep)
                session.flush()
                session.add_all(rows)
                audit.record(session, actor, "create_sweep", sweep.id, name=name, runs=len(rows))
            undo.pop_all()
        self.audience.tell(rows)
        return sweep

    def get_sweep(self, sweep_id: str) -> SweepRow:
        """A sweep; its runs are `find(RunFilter(sweep_id=..., archived=None))`.

        Raises:
            UnknownSweepError: there is none of that id.
        """
        with self._database.reading() as session:
            row = session.get(SweepRow, sweep_id)
        if row is None:
            raise UnknownSweepError(sweep_id)
        return row

    def page_sweeps(self, *, after: str | None = None, limit: int = 50) -> list[SweepRow]:
        """Sweeps, newest first, from behind the one of id `after`."""
        query = select(SweepRow).order_by(SweepRow.id.desc()).limit(limit)
        if after is not None:
            query = query.where(SweepRow.id < after)
        with self._database.reading() as session:
            return list(session.scalars(query))

    def sweep_states(self, sweep_ids: Sequence[str]) -> dict[str, dict[str, int]]:
        """How many runs of each sweep are in each state."""
        with self._database.reading() as session:
            return states_of_sweeps(session, sweep_ids, without=self.index.gone)

    def stop_sweep(self, sweep_id: str, actor: str) -> SweepRow:
        """Stops every run of a sweep that is not over.

        Raises:
            UnknownSweepError: there is none of that id.
        """
        sweep = self.get_sweep(sweep_id)
        for row in self.find(RunFilter(sweep_id=sweep_id, archived=None)):
            self.request_stop(row.id, actor)
        return sweep


def _run(session: Session, run_id: str) -> RunRow:
    row = session.get(RunRow, run_id)
    if row is None:
        raise UnknownRunError(run_id)
    return row


def _new_id() -> str:
    return str(uuid_utils.uuid7())
