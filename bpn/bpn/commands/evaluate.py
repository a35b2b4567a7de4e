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
from bpn.evaluation.outcome import distinct_trials, outcome, summarize
from bpn.evaluation.shown import shown
from bpn.evaluation.trials import PlayedPolicy, TrialPlan, play
from bpn.options import add_runs_dir
from bpn.outputs import check_output
from bpn.progress import bar
from bpn.this_machine import ThisMachine
from bpn_shared.bnn.weights import Weights, decode_weights
from bpn_shared.errors import InputError
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.gym_modules import add_gym_modules, allowed_modules
from bpn_shared.runtime.service import stop_on_signals
from bpn_shared.spec.config import Pacing, RunConfig
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
    folder = RunFolder.open(options.runs_dir, options.run_id)
    trials = _trials(options, folder.config())
    version = folder.best().version if options.best else options.version
    config, weights = trials.config(folder.config()), _weights(folder, version)
    video, plot = _media(options, config.task_spec)
    gym_modules = allowed_modules(options.gym_modules)
    ThisMachine(gym_modules).check_playing(config)
    stop = stop_on_signals()
    with bar("trials", trials.count) as over:
        episodes = play(
            folder,
            weights,
            trials,
            stop,
            on_progress=over,
            say=over.say,
            gym_modules=gym_modules,
        )
    if stop.is_set():
        return 130
    result = {
        "run_id": str(folder.run),
        "task": config.task,
        "algorithm": config.algorithm,
        "weights_version": weights.version,
        "policy": trials.policy,
        "seed": trials.seed,
        "pacing": config.pacing,
        "action_delay_ms": config.action_delay_ms,
        **summarize(
            config,
            [outcome(config, episode) for episode in episodes],
            distinct=distinct_trials(episodes),
        ),
    }
    if options.json:
        print(json.dumps(result), flush=True)
    else:
        Console().print("\n".join(shown(result, config)), highlight=False, soft_wrap=True)
    # What was measured stands whatever becomes of the pictures.
    if video is not None:
        bars = not options.no_bars
        with _writing("--video", options.video):
            video.write(options.video, episodes, config.task_spec, bars=bars)
    if plot is not None:
        with _writing("--plot", options.plot):
            plot.write(options.plot, config.task_spec, episodes)
    return 0


@contextmanager
def _writing(option: str, path: Path) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # encoders have exceptions of their own
        raise CommandError(f"{option} {path} could not be written: {error}") from error


def _trials(options: argparse.Namespace, trained: RunConfig) -> TrialPlan:
    if options.trials < 1:
        raise InputError(f"--trials = {options.trials} must be at least 1")
    changes = {
        "pacing": options.pacing,
        "action_delay_ms": options.action_delay_ms,
        "robots": options.robots,
        "kernel": options.kernel or trained.kernel,
    }
    seed = trained.seed if options.seed is None else options.seed
    return TrialPlan(options.trials, options.policy, seed, changes)


def _weights(folder: RunFolder, version: int | None) -> Weights:
    if version is None:
        return folder.newest_weights()
    path = folder.weights_path(version)
    if not path.exists():
        raise InputError(
            f"--version {version}: not in {path.parent}, the newest is {folder.newest_weights().version}"
        )
    return decode_weights(path.read_bytes())


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
