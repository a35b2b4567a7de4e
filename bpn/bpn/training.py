"""Training from beginning to end: by the workers of a dashboard on the same runs folder, else by own processes."""

import threading
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any

from rich.console import Console

from bpn.dashboard import Dashboard, DashboardError
from bpn.local_run import execute, follow, new_run, private_endpoint
from bpn.outputs import check_runs_dir
from bpn.run import Run
from bpn.this_machine import ThisMachine
from bpn_shared.errors import InputError
from bpn_shared.runs.creation import configure, request_values
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.gym_modules import allowed_modules
from bpn_shared.spec.gym import modules_named
from bpn_shared.spec.tasks import is_gym

_SEEN = {
    "observations": "the environment's observations",
    "renders": "what the environment renders",
}
_NOTICED_S = 8.0
_AGAIN_S = 0.5


def train(
    task: str | None = None,
    *,
    resume: str | None = None,
    runs_dir: Path | str = "runs",
    gym_modules: Collection[str] = (),
    quiet: bool = False,
    **options: Any,
) -> Run:
    """Trains a policy, as `bpn train` does; returns when the run is finished.

    Args:
        task: what the robot learns, such as "reaching" or "gym:CartPole-v1".
        resume: instead of a task: the run to go on with, its id or the beginning or end of it.
        runs_dir: where the run's folder will be. If a dashboard runs there, its workers train.
        gym_modules: what may be imported for a `gym:` task, beside what its own name says.
        quiet: no line for each iteration. Why there is no progress is told on standard error all the same.
        options: of the configuration, by the names of the command's options with underscores; what is not given
            is the task's preset.

    Returns:
        The run, for a look at its metrics, episodes and policy.

    Raises:
        InputError: an option is wrong, or this machine cannot do the run.
        RunFailedError: it cannot go on; the message says why.
        KeyboardInterrupt: Ctrl-C; `resume` goes on.
    """
    folder_of_runs = Path(runs_dir)
    dashboard = Dashboard.find(folder_of_runs)
    given = {name: value for name, value in options.items() if value is not None}
    modules = modules_here(task, given.get("env_wrappers", ""), gym_modules)
    folder = begin(
        task, resume, given, runs_dir=folder_of_runs, dashboard=dashboard, gym_modules=modules
    )
    out = Console(quiet=quiet)
    tell_run(folder, out, dashboard)
    learn(folder, dashboard, threading.Event(), out, modules)
    return Run(folder)


def modules_here(
    task: str | None, env_wrappers: str, gym_modules: Collection[str]
) -> frozenset[str]:
    """What `gym:` tasks may import in processes of this call: what its own words name.

    A run that is resumed names nothing: its configuration may be from elsewhere.

    Raises:
        InputError: one is no module's name.
    """
    allowed = allowed_modules(",".join(gym_modules))
    if task is None or not is_gym(task):
        return allowed
    return allowed | frozenset(modules_named(task, env_wrappers))


def begin(
    task: str | None,
    resume: str | None,
    options: Mapping[str, Any],
    *,
    runs_dir: Path,
    dashboard: Dashboard | None,
    gym_modules: Collection[str],
) -> RunFolder:
    """The folder of a new run, or of the one to go on with, which a dashboard has in its queue.

    Raises:
        InputError: an option is wrong, or the machine cannot do the run.
    """
    if resume is not None:
        given = ["TASK"] * (task is not None) + [f"--{name.replace('_', '-')}" for name in options]
        if given:
            raise InputError(f"a resumed run keeps its configuration: leave out {', '.join(given)}")
        folder = RunFolder.open(runs_dir, resume)
        if dashboard is None:
            ThisMachine(gym_modules).check(folder.config())
        else:
            _resume(dashboard, str(folder.run))
        return folder
    if task is None:
        raise InputError("a task is missing, or which run to resume")
    values = {"task": task, **options}
    if dashboard is None:
        config = configure(values, ThisMachine(gym_modules))
        check_runs_dir(runs_dir)
        return new_run(runs_dir, config)
    return RunFolder.open(runs_dir, dashboard.create_run(request_values(values))["id"])


def tell_run(folder: RunFolder, out: Console, dashboard: Dashboard | None) -> None:
    """Which run it is, and what is before it."""
    config = folder.config()
    say = partial(out.print, soft_wrap=True, highlight=False, markup=False)
    say(
        f"run {folder.run} ({config.algorithm}, {config.task}, seed {config.seed}) in {folder.path}"
    )
    if config.frames_from != "auto":
        say(f"the policy sees {_SEEN[config.frames_from]}")
    if dashboard is not None:
        say_place(dashboard, say)


def say_place(dashboard: Dashboard, say: Callable[[str], None]) -> None:
    """How many runs the dashboard's workers will do first, or are doing."""
    before = dashboard.runs(state="queued,running", limit="1")["total"] - 1
    if before > 0:
        say(f"{before} {'run' if before == 1 else 'runs'} before it; {dashboard.url} shows them")


def learn(
    folder: RunFolder,
    dashboard: Dashboard | None,
    stop: threading.Event,
    out: Console,
    gym_modules: Collection[str],
) -> None:
    """Until the run is finished, or `stop` is set.

    Raises:
        RunFailedError: it cannot go on; the message says why.
    """
    if dashboard is None:
        execute(folder, endpoint=private_endpoint(), stop=stop, out=out, gym_modules=gym_modules)
    else:
        follow(dashboard, folder, stop=stop, out=out)


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
