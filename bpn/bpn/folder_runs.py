"""The runs of a folder without a dashboard: told in the words of one, and removed as it does."""

import getpass
import logging
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bpn.errors import CommandError
from bpn.terminal import command
from bpn_dashboard.api.models import RemovedRun, Run
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.columns import OWN
from bpn_dashboard.registry.folders import name_in_trash, named_contents, row_of
from bpn_dashboard.registry.retention import Rule
from bpn_shared.errors import InputError
from bpn_shared.runs.folder import STATES, RunFolder, RunOwnedError, run_folders
from bpn_shared.runs.opening import folder_names, is_run_id
from bpn_shared.runs.trash import NotThereError, Trash
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)


class FolderRuns:
    """Reads and moves run folders. A dashboard that cannot be found here notices what becomes of them.

    Raises:
        InputError: there is no such folder.
    """

    def __init__(self, runs_dir: Path) -> None:
        if not runs_dir.is_dir():
            start = command("bpn", "up", "--runs-dir", runs_dir)
            raise InputError(f"--runs-dir {runs_dir}: there is no such folder; `{start}` makes one")
        self._runs_dir = runs_dir
        self._trash = Trash(runs_dir)

    def listed(self, query: Mapping[str, str], limit: int) -> tuple[list[dict[str, Any]], int]:
        """See `Dashboard.listed`."""
        states = [state for state in query["state"].split(",") if state]
        if unknown := set(states) - set(STATES):
            raise InputError(f"--state {', '.join(unknown)}: unknown; one of: {', '.join(STATES)}")
        key = query["sort"].lstrip("-")
        if key not in OWN:
            raise InputError(f"--sort {query['sort']}: unknown; one of: {', '.join(OWN)}")
        column = OWN[key].key
        rows = [
            row
            for row in self._rows()
            if _mentions(row, query["search"])
            and (not states or row.state in states)
            and (row.archived_at is not None) == (query["archived"] == "true")
        ]
        known = [row for row in rows if getattr(row, column) is not None]
        known.sort(
            key=lambda row: (getattr(row, column), row.id), reverse=query["sort"].startswith("-")
        )
        ordered = known + [row for row in rows if getattr(row, column) is None]
        return [_shown(row) for row in ordered[:limit]], len(rows)

    def named(self, text: str) -> dict[str, Any]:
        """See `Dashboard.named`."""
        return _shown(row_of(RunFolder.open(self._runs_dir, text)))

    def remove(self, run_id: str) -> dict[str, Any]:
        """See `Dashboard.remove`."""
        try:
            removed = self._trash.put(run_id, f"{getpass.getuser()} at {socket.gethostname()}")
        except RunOwnedError as error:
            raise CommandError(str(error)) from error
        name = name_in_trash(self._trash, run_id)
        return RemovedRun.of(removed, name).model_dump(mode="json")

    def restore(self, run_id: str) -> dict[str, Any]:
        """See `Dashboard.restore`."""
        self._trash.restore(run_id)
        return self.named(run_id)

    def trash(self) -> list[dict[str, Any]]:
        """See `Dashboard.trash`."""
        contents = named_contents(self._trash)
        return [RemovedRun.of(removed, name).model_dump(mode="json") for removed, name in contents]

    def prune(
        self, keep: int | None, older_than_days: float | None, *, dry_run: bool
    ) -> list[dict[str, Any]]:
        """See `Dashboard.prune`."""
        rule = Rule(keep, older_than_days)
        rule.check()
        told = []
        for row in rule.outdated(self._rows(), time.time()):
            trouble = ""
            try:
                _ = dry_run or self.remove(row.id)
            except (CommandError, NotThereError) as error:
                trouble = str(error)
            told.append({"id": row.id, "name": row.name, "ok": not trouble, "trouble": trouble})
        return told

    def delete(self, run_id: str) -> None:
        """Deletes a removed run for good, whether a dashboard runs or not: it has no row."""
        self._trash.delete(run_id)

    def sweep_up(self) -> None:
        """Finishes deletions that were interrupted."""
        self._trash.sweep_up()

    def _rows(self) -> list[RunRow]:
        rows = []
        for folder in run_folders(self._runs_dir):
            try:
                rows.append(row_of(folder))
            except (ConfigError, OSError) as error:
                log.warning("left out: %s", error)
        return rows


def run_id_of(runs_dir: Path, text: str) -> str:
    """The id of the run of which that is the unique beginning or end, whatever state its folder is in.

    Raises:
        InputError: there is none, or there are several.
    """
    names = [name for name in folder_names(runs_dir) if is_run_id(name)]
    found = [name for name in names if name.startswith(text) or name.endswith(text)]
    if len(found) == 1:
        return found[0]
    return RunFolder.open(runs_dir, text).path.name  # which says why not


def _mentions(row: RunRow, text: str) -> bool:
    wanted = text.casefold()
    return any(
        wanted in part.casefold() for part in (row.name, row.notes, row.id, " ".join(row.tags))
    )


def _shown(row: RunRow) -> dict[str, Any]:
    row.waiting_reason = row.waiting_reason or ""
    return Run.of(row).model_dump(mode="json")
