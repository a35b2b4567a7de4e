"""`bpn train`: one run from beginning to end, or from where it was interrupted.

Where a dashboard runs on the same runs folder, its workers do it; otherwise processes of its own.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial

from rich.console import Console

from bpn.dashboard import Dashboard
from bpn.options import add_run_options, add_runs_dir, given_run_options
from bpn.summary import summarize
from bpn.terminal import command
from bpn.training import begin, learn, modules_here, tell_run
from bpn_shared.errors import InputError
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.gym_modules import add_gym_modules, as_arguments
from bpn_shared.runtime.service import stop_on_signals
from bpn_shared.spec.installed import task_names


def add_options(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    parser.add_argument("task", nargs="?", metavar="TASK", help=f"one of: {task_names()}")
    parser.add_argument("--resume", metavar="RUN", help="go on with this run (id or its end)")
    parser.add_argument("--json", action="store_true", help="print one final JSON object only")
    add_runs_dir(parser)
    add_gym_modules(parser)
    add_run_options(parser, arguments)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Trains; exit status 130 if interrupted, with a folder that `--resume` takes."""
    dashboard = Dashboard.find(options.runs_dir)
    gym_modules = _modules(options)
    folder = folder_of(options, dashboard)
    stop = stop_on_signals()  # before the run's name is told: an interrupt then says how to go on
    out = Console(file=sys.stderr if options.json else sys.stdout)
    say = partial(out.print, soft_wrap=True, highlight=False, markup=False)
    tell_run(folder, out, dashboard)
    learn(folder, dashboard, stop, out, gym_modules)
    summary = summarize(folder)
    if options.json:
        print(json.dumps(summary))
    elif summary["state"] == "finished":
        if reason := folder.state().error:
            say(reason)
        last = summary["returns"][-5:]
        unit = folder.config().task_spec.return_unit
        say(
            f"finished: mean return of the last {len(last)} iterations {sum(last) / len(last):.1f}{unit}"
        )
    if summary["state"] == "finished":
        return 0
    allow = as_arguments(gym_modules) if dashboard is None else []
    again = command(
        "bpn", "train", "--resume", str(folder.run), "--runs-dir", options.runs_dir, *allow
    )
    say(f"stopped; go on with: {again}")
    return 130


def folder_of(options: argparse.Namespace, dashboard: Dashboard | None) -> RunFolder:
    """The folder of the run that the options ask for; see `begin`.

    Raises:
        InputError: an option is wrong, or the machine cannot do the run.
    """
    if options.resume is None and options.task is None:
        raise InputError(f"TASK is missing; one of: {task_names()}, or --resume RUN")
    return begin(
        options.task,
        options.resume,
        given_run_options(options),
        runs_dir=options.runs_dir,
        dashboard=dashboard,
        gym_modules=_modules(options),
    )


def _modules(options: argparse.Namespace) -> frozenset[str]:
    return modules_here(options.task, options.env_wrappers or "", [options.gym_modules])
