"""`bpn runs`: the runs of a folder: with a dashboard by its registry, without one as the folders say."""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bpn.commands import removal
from bpn.dashboard import Dashboard
from bpn.folder_runs import FolderRuns
from bpn.options import add_run_options, add_runs_dir, given_run_options
from bpn.terminal import command
from bpn_shared.errors import InputError
from bpn_shared.runs.creation import request_values
from bpn_shared.spec.tasks import TASK_NAMES

Action = Callable[[argparse.Namespace, Any], int | None]
"""Takes the options, and the dashboard; where none is needed, `FolderRuns` if there is none."""


def add_options(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    actions = parser.add_subparsers(required=True, metavar="ACTION")

    listing = _action(actions, "ls", _list, "list runs, newest first")
    listing.add_argument("--search", default="", help="part of name, notes, tags or id")
    listing.add_argument("--state", default="", help="states, separated by commas")
    listing.add_argument("--archived", action="store_true", help="those in the archive")
    listing.add_argument(
        "--sort", default="-created_at", help="a key; descending with a minus: --sort=-return_best"
    )
    listing.add_argument("--limit", type=int, default=50, help="at most so many (default 50)")

    _with_run(_action(actions, "show", _show, "what is known of a run"))
    start = _action(actions, "start", _start, "put a new run into the queue", alone=False)
    start.add_argument("task", metavar="TASK", help=f"one of: {TASK_NAMES}")
    start.add_argument("--name", default="", help="to find it again")
    start.add_argument("--tag", action="append", default=[], help="may be repeated")
    add_run_options(start, arguments)
    _with_run(_action(actions, "stop", _stop, "ask a run's workers to stop", alone=False))
    _with_run(_action(actions, "resume", _resume, "let workers go on with a run", alone=False))

    _with_runs(_action(actions, "rm", removal.remove, "move runs to the trash"))
    _with_runs(_action(actions, "restore", removal.restore, "bring runs back from the trash"))
    _action(actions, "trash", removal.trash, "list what is in the trash")
    empty = _action(actions, "empty-trash", removal.empty_trash, "delete removed runs for good")
    _with_runs(empty, count="*")
    empty.add_argument(
        "--expired", action="store_true", help="only those that are no longer to be kept"
    )
    prune = _action(
        actions, "prune", removal.prune,
        "move old runs to the trash, but for those that are queued or learned, or have the tag 'keep'",
    )  # fmt: skip
    prune.add_argument("--keep", type=int, metavar="N", help="but for the N newest")
    prune.add_argument(
        "--older-than", type=float, metavar="DAYS", help="to which nothing has happened for so long"
    )
    prune.add_argument("--dry-run", action="store_true", help="only say which they would be")

    export = _action(
        actions, "export", _export, "write metrics to a file", answers=False, alone=False
    )
    _with_runs(export)
    export.add_argument("--metrics", default="", help="separated by commas (default: all)")
    export.add_argument("--output", type=Path, required=True, help="FILE.csv or FILE.parquet")


def _action(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    act: Action,
    text: str,
    *,
    answers: bool = True,
    alone: bool = True,
) -> argparse.ArgumentParser:
    parser = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
    add_runs_dir(parser)
    if answers:
        parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run, act=act, alone=alone)
    return parser


def _with_run(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run_id", metavar="RUN", help="id of the run, or its end")


def _with_runs(parser: argparse.ArgumentParser, count: str = "+") -> None:
    what = "ids, or their ends" if count == "+" else "ids, or their ends (default: all)"
    parser.add_argument("run_ids", nargs=count, metavar="RUN", help=what)


def run(options: argparse.Namespace) -> int:
    """Does one action; exit status 1 if a part of it could not be done.

    Raises:
        InputError: no dashboard runs on these runs and the action needs one, or it refuses what was asked.
    """
    dashboard = Dashboard.find(options.runs_dir)
    if dashboard is None and not options.alone:
        start = command("bpn", "up", "--runs-dir", options.runs_dir)
        raise InputError(
            f"no dashboard runs on --runs-dir {options.runs_dir}: start one with `{start}`"
        )
    return options.act(options, dashboard or FolderRuns(options.runs_dir)) or 0


def _list(options: argparse.Namespace, runs: removal.Runs) -> None:
    query = {"search": options.search, "state": options.state, "sort": options.sort}
    query["archived"] = str(options.archived).lower()
    items, total = runs.listed(query, options.limit)
    if options.json:
        print(json.dumps(items))
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("id", "name", "state"):
        table.add_column(name, no_wrap=name != "name")
    for name in ("iteration", "return", "best", "age"):
        table.add_column(name, justify="right", no_wrap=True)
    for item in items:
        returns = item["summary"]["returns"]
        table.add_row(
            item["id"][-12:], item["name"], item["state"],
            f"{item['iteration']}/{item['iterations']}",
            _return(returns, "last"), _return(returns, "best"), _age(item["created_at_unix_s"]),
        )  # fmt: skip
    console = Console()
    console.print(table)
    if total > len(items):
        console.print(f"{len(items)} of {total}; --limit shows more", style="dim")


def _show(options: argparse.Namespace, runs: removal.Runs) -> None:
    _print(options, runs.named(options.run_id))


def _start(options: argparse.Namespace, dashboard: Dashboard) -> None:
    values = request_values({"task": options.task, **given_run_options(options)})
    made = dashboard.create_run(values, options.name, options.tag)
    _print(options, made)


def _stop(options: argparse.Namespace, dashboard: Dashboard) -> None:
    _print(options, dashboard.stop(dashboard.named(options.run_id)["id"]))


def _resume(options: argparse.Namespace, dashboard: Dashboard) -> None:
    _print(options, dashboard.resume(dashboard.named(options.run_id)["id"]))


def _export(options: argparse.Namespace, dashboard: Dashboard) -> None:
    form = options.output.suffix.removeprefix(".")
    if form not in ("csv", "parquet"):
        raise InputError(f"--output {options.output}: the name must end in .csv or .parquet")
    run_ids = [dashboard.named(text)["id"] for text in options.run_ids]
    metrics = [name for name in options.metrics.split(",") if name]
    metrics = metrics or sorted({name for run in run_ids for name in dashboard.metrics(run)})
    if not metrics:
        raise InputError("the runs have no metrics yet")
    partial = options.output.with_name(options.output.name + ".part")
    with partial.open("wb") as file:
        for piece in dashboard.export(run_ids, metrics, form):
            file.write(piece)
    partial.replace(options.output)
    print(f"{options.output}: {len(run_ids)} runs, {len(metrics)} metrics", file=sys.stderr)


def _print(options: argparse.Namespace, item: dict[str, Any]) -> None:
    if options.json:
        print(json.dumps(item))
        return
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in _rows(item):
        table.add_row(name, value)
    Console().print(table)


def _rows(item: dict[str, Any]) -> Sequence[tuple[str, str]]:
    returns = item["summary"]["returns"]
    config = item["config"]
    told = {
        "id": item["id"],
        "name": item["name"],
        "state": item["state"] + (f": {item['error']}" if item["error"] else ""),
        "iterations": f"{item['iteration']} of {item['iterations']}, attempt {item['attempt']}",
        "return": f"last {_return(returns, 'last')}, best {_return(returns, 'best')}",
        "weights version": str(item["weights_version"] or 0),
        "tags": ", ".join(item["tags"]),
        "notes": item["notes"],
        "created": f"{_age(item['created_at_unix_s'])} ago",
    }
    return [*told.items(), *((f"  {key}", str(config[key])) for key in sorted(config))]


def _return(returns: dict[str, Any], which: str) -> str:
    value = returns[which]
    return "–" if value is None else f"{value:.1f} {returns['unit']}".rstrip()


def _age(since_unix_s: float) -> str:
    seconds = time.time() - since_unix_s
    for unit, length_s in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{seconds:.0f} s"
