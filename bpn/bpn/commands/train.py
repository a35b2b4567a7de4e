"""`bpn train`: one run from beginning to end, or from where it was interrupted.

Where a dashboard runs on the same runs folder, its workers do it; otherwise processes of its own.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from http import HTTPStatus

from rich.console import Console

from bpn.dashboard import Dashboard, DashboardError
from bpn.local_run import execute, follow, new_run, private_endpoint
from bpn.options import add_run_options, add_runs_dir, given_run_options
from bpn.outputs import check_runs_dir
from bpn.summary import summarize
from bpn.terminal import command
from bpn.this_machine import ThisMachine
from bpn_shared.errors import InputError
from bpn_shared.runs.creation import configure, request_values
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.gym_modules import add_gym_modules, allowed_modules, as_arguments
from bpn_shared.runtime.service import stop_on_signals
from bpn_shared.spec.gym import modules_named
from bpn_shared.spec.installed import task_names
from bpn_shared.spec.tasks import is_gym

_SEEN = {
    "observations": "the environment's observations",
    "renders": "what the environment renders",
}
_NOTICED_S = 8.0
_AGAIN_S = 0.5


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
    gym_modules = modules_here(options)
    folder = folder_of(options, dashboard)
    stop = stop_on_signals()  # before the run's name is told: an interrupt then says how to go on
    config = folder.config()
    out = Console(file=sys.stderr if options.json else sys.stdout)
    say = partial(out.print, soft_wrap=True, highlight=False, markup=False)
    say(
        f"run {folder.run} ({config.algorithm}, {config.task}, seed {config.seed}) in {folder.path}"
    )
    if config.frames_from != "auto":
        say(f"the policy sees {_SEEN[config.frames_from]}")
    if dashboard is not None:
        say_place(dashboard, say)
    if dashboard is None:
        execute(folder, endpoint=private_endpoint(), stop=stop, out=out, gym_modules=gym_modules)
    else:
        follow(dashboard, folder, stop=stop, out=out)
    summary = summarize(folder)
    if options.json:
        print(json.dumps(summary))
    elif summary["state"] == "finished":
        if reason := folder.state().error:
            say(reason)
        last = summary["returns"][-5:]
        say(
            f"finished: mean return of the last {len(last)} iterations "
            f"{sum(last) / len(last):.1f}{config.task_spec.return_unit}"
        )
    if summary["state"] == "finished":
        return 0
    allow = as_arguments(gym_modules) if dashboard is None else []
    again = command(
        "bpn", "train", "--resume", str(folder.run), "--runs-dir", options.runs_dir, *allow
    )
    say(f"stopped; go on with: {again}")
    return 130


def modules_here(options: argparse.Namespace) -> frozenset[str]:
    """What `gym:` tasks may import in processes of this command: what its own words name.

    A run that is resumed names nothing: its configuration may be from elsewhere.

    Raises:
        InputError: one is no module's name.
    """
    allowed = allowed_modules(options.gym_modules)
    if options.task is None or not is_gym(options.task):
        return allowed
    return allowed | frozenset(modules_named(options.task, options.env_wrappers or ""))


def folder_of(options: argparse.Namespace, dashboard: Dashboard | None) -> RunFolder:
    """The folder of the run that the options ask for: a new one, or the one to go on with.

    Raises:
        InputError: an option is wrong, or the machine cannot do the run.
    """
    if options.resume is None:
        if options.task is None:
            raise InputError(f"TASK is missing; one of: {task_names()}, or --resume RUN")
        values = {"task": options.task, **given_run_options(options)}
        if dashboard is None:
            config = configure(values, ThisMachine(modules_here(options)))
            check_runs_dir(options.runs_dir)
            return new_run(options.runs_dir, config)
        run = dashboard.create_run(request_values(values))
        return RunFolder.open(options.runs_dir, run["id"])
    given = ["TASK"] * (options.task is not None) + [f"--{n}" for n in given_run_options(options)]
    if given:
        raise InputError(f"a resumed run keeps its configuration: leave out {', '.join(given)}")
    folder = RunFolder.open(options.runs_dir, options.resume)
    if dashboard is None:
        ThisMachine(modules_here(options)).check(folder.config())
    else:
        _resume(dashboard, str(folder.run))
    return folder


def say_place(dashboard: Dashboard, say: Callable[[str], None]) -> None:
    """How many runs the dashboard's workers will do first, or are doing."""
    before = dashboard.runs(state="queued,running", limit="1")["total"] - 1
    if before > 0:
        say(f"{before} {'run' if before == 1 else 'runs'} before it; {dashboard.url} shows them")


def _resume(dashboard: Dashboard, run_id: str) -> None:
    """Resumes a run that the dashboard may have to notice first: its folder may be new to it."""
    deadline_s = time.monotonic() + _NOTICED_S
    while True:
        try:
            dashboard.resume(run_id)
            return
        except DashboardError as error:
            if error.status != HTTPStatus.NOT_FOUND or time.monotonic() > deadline_s:
                raise
        time.sleep(_AGAIN_S)
