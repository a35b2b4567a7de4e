"""`bpn eval`: plays a run's policy with real processes and reports what came of it."""

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

from rich.console import Console

from bpn import optional
from bpn.errors import CommandError
from bpn.evaluation.evaluate import evaluate
from bpn.evaluation.shown import shown
from bpn.evaluation.trials import PlayedPolicy
from bpn.options import add_runs_dir
from bpn.outputs import check_output
from bpn.progress import bar
from bpn.run import open_run
from bpn_shared.runtime.gym_modules import add_gym_modules
from bpn_shared.runtime.service import stop_on_signals
from bpn_shared.spec.sections import Pacing
from bpn_shared.spec.tasks import TaskSpec

_FILMS, _PLOTS = (".mp4", ".gif"), (".png", ".svg", ".pdf")


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument("run_id", metavar="RUN", help="id of the run, or its end")
    parser.add_argument("--trials", type=int, default=10, help="episodes (default 10)")
    parser.add_argument(
        "--policy",
        choices=get_args(PlayedPolicy),
        default="greedy",
        help="the best action; drawn from the outputs' softmax, as bpn, cvi and dpp train (bqn and dqn do "
        "not); or any (default greedy)",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--version", type=int, help="weights version (default: the newest)")
    which.add_argument(
        "--best",
        action="store_true",
        help="the version that was the best in the evaluations during training",
    )
    parser.add_argument("--seed", type=int, help="of starts and draws (default: the run's)")
    parser.add_argument("--pacing", choices=get_args(Pacing), default="lockstep")
    parser.add_argument(
        "--action-delay-ms",
        type=float,
        default=0.0,
        metavar="MS",
        help="time added between a frame and its action's effect; needs --pacing realtime",
    )
    parser.add_argument(
        "--disturb",
        metavar="KIND=LEVEL,...",
        help="disturbances of camera and servos in place of the run's, such as noise=25,offset=-30..30; '' for "
        "none (docs/disturbances.md)",
    )
    parser.add_argument("--kernel", help="an installed one, such as golden (default: the run's)")
    parser.add_argument("--robots", type=int, default=1, help="trials played side by side")
    parser.add_argument("--video", type=Path, metavar="FILE", help="film, " + " or ".join(_FILMS))
    parser.add_argument("--no-bars", action="store_true", help="film without action preferences")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="trajectories, " + ", ".join(_PLOTS)
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_gym_modules(parser)
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Plays the trials; exit status 130 if interrupted."""
    played = open_run(options.run_id, runs_dir=options.runs_dir)
    task = played.config.task_spec
    video, plot = _media(options, task)
    with bar("trials", max(options.trials, 1)) as over:
        found = evaluate(
            played,
            trials=options.trials,
            policy=options.policy,
            version="best" if options.best else options.version,
            seed=options.seed,
            pacing=options.pacing,
            action_delay_ms=options.action_delay_ms,
            disturb=options.disturb,
            kernel=options.kernel,
            robots=options.robots,
            gym_modules=[options.gym_modules],
            stop=stop_on_signals(),
            on_progress=over,
            say=over.say,
        )
    if options.json:
        print(json.dumps(found.result), flush=True)
    else:
        lines = shown(found.result, played.config)
        Console().print("\n".join(lines), highlight=False, soft_wrap=True)
    # What was measured stands whatever becomes of the pictures.
    if video is not None:
        with _writing("--video", options.video):
            video.write(options.video, found.episodes, task, bars=not options.no_bars)
    if plot is not None:
        with _writing("--plot", options.plot):
            plot.write(options.plot, task, found.episodes)
    return 0


@contextmanager
def _writing(option: str, path: Path) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # encoders have exceptions of their own
        raise CommandError(f"{option} {path} could not be written: {error}") from error


def _media(options: argparse.Namespace, task: TaskSpec) -> tuple[Any, Any]:
    """The modules that write what is asked for: what cannot be written is said before the trials, not after."""
    video = plot = None
    if options.video is not None:
        check_output("--video", options.video, _FILMS)
        video = optional.load("bpn.evaluation.video", extra="media", wanted_by="--video")
    if options.plot is not None:
        check_output("--plot", options.plot, _PLOTS)
        plot = optional.load("bpn.evaluation.plot", extra="media", wanted_by="--plot")
        plot.plot_of(task)
    return video, plot
