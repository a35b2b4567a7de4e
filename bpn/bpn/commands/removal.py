"""`bpn runs rm`, `restore`, `prune`, `trash`, `empty-trash`: runs go to the trash, and come back from there."""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from bpn.dashboard import Dashboard
from bpn.errors import CommandError
from bpn.folder_runs import FolderRuns, run_id_of
from bpn.terminal import command
from bpn_dashboard.registry.retention import Rule
from bpn_shared.errors import InputError, one_line

Runs = Dashboard | FolderRuns
_SHORT = 12


def remove(options: argparse.Namespace, runs: Runs) -> int:
    """Moves runs to the trash; those named wrongly are told before anything is done."""
    ids = [run_id_of(options.runs_dir, text) for text in options.run_ids]
    removed, status = _each(ids, runs.remove)
    if options.json:
        print(json.dumps(removed))
        return status
    for item in removed:
        back = command(
            "bpn", "runs", "restore", item["id"][-_SHORT:], "--runs-dir", options.runs_dir
        )
        print(f"removed {item['id']} ({item['name']}); until {_day(item)}: {back}")
    return status


def restore(options: argparse.Namespace, runs: Runs) -> int:
    """Brings runs back."""
    there = runs.trash()
    restored, status = _each([_in_trash(there, text) for text in options.run_ids], runs.restore)
    if options.json:
        print(json.dumps(restored))
        return status
    for item in restored:
        print(f"restored {item['id']} ({item['name']})")
    return status


def trash(options: argparse.Namespace, runs: Runs) -> int:
    """Shows what can be restored."""
    items = runs.trash()
    if options.json:
        print(json.dumps(items))
        return 0
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("id", "name", "size", "removed by", "kept until"):
        table.add_column(
            name, no_wrap=name != "name", justify="right" if name == "size" else "left"
        )
    for item in items:
        row = item["id"][-_SHORT:], item["name"], _size(item), item["removed_by"], _day(item)
        table.add_row(*row)
    Console().print(table)
    return 0


def empty_trash(options: argparse.Namespace, _runs: Runs) -> int:
    """Deletes for good, beside a dashboard too: it knows nothing of what is in the trash."""
    runs = FolderRuns(options.runs_dir)
    there = runs.trash()
    ids = [_in_trash(there, text) for text in options.run_ids] or [item["id"] for item in there]
    if options.expired:
        over = {item["id"] for item in there if item["kept_until_unix_s"] <= time.time()}
        ids = [run_id for run_id in ids if run_id in over]

    def delete(run_id: str) -> dict[str, Any]:
        runs.delete(run_id)
        return {"id": run_id}

    deleted, status = _each(ids, delete)
    runs.sweep_up()
    if options.json:
        print(json.dumps(deleted))
    else:
        print(f"{len(deleted)} {'run' if len(deleted) == 1 else 'runs'} deleted for good")
    return status


def prune(options: argparse.Namespace, runs: Runs) -> int:
    """Moves old runs to the trash."""
    Rule(options.keep, options.older_than).check()  # before a dashboard is asked: JSON has no NaN
    told = runs.prune(options.keep, options.older_than, dry_run=options.dry_run)
    for item in told:
        if not item["ok"]:
            print(f"bpn: not removed: {item['trouble']}", file=sys.stderr)
    if options.json:
        print(json.dumps(told))
    else:
        done = [item for item in told if item["ok"]]
        for item in done:
            print(
                f"{'would remove' if options.dry_run else 'removed'} {item['id']} ({item['name']})"
            )
        if not done:
            print("nothing to remove")
    return 0 if all(item["ok"] for item in told) else 1


def _each(
    run_ids: Sequence[str], act: Callable[[str], dict[str, Any]]
) -> tuple[list[dict[str, Any]], int]:
    """What was done, and the exit status; what could not be is said, and the others go on."""
    done, status = [], 0
    for run_id in dict.fromkeys(run_ids):
        try:
            done.append(act(run_id))
        except (InputError, CommandError) as error:
            reason = str(error)
        except OSError as error:
            reason = one_line(error)
        else:
            continue
        print(f"bpn: {reason}", file=sys.stderr)
        status = 1
    return done, status


def _in_trash(there: Sequence[dict[str, Any]], text: str) -> str:
    ids = [str(item["id"]) for item in there]
    found = [run_id for run_id in ids if run_id.startswith(text) or run_id.endswith(text)]
    if len(found) != 1:
        count = f"{len(found)} runs in the trash match" if found else "no run in the trash matches"
        raise InputError(f"{count} {text!r}; `bpn runs trash` shows them")
    return found[0]


def _day(item: dict[str, Any]) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(item["kept_until_unix_s"]))


def _size(item: dict[str, Any]) -> str:
    size_bytes = item["size_bytes"]
    return "" if size_bytes is None else f"{size_bytes / 2**20:,.1f} MiB"
