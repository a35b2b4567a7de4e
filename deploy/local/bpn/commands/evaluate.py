"""`bpn eval`: plays a run's policy with real processes and reports what came of it."""

import argparse
import json
from pathlib import Path
from typing import Any, get_args

from rich.console import Console

from bpn import optional
from bpn.evaluation.outcome import outcome, summarize
from bpn.evaluation.progress import trials_bar
from bpn.evaluation.trials import PlayedPolicy, Trials, play
from bpn.options import add_runs_dir
from bpn_shared.config import ConfigError, Kernel, Pacing, RunConfig
from bpn_shared.runs.folder import RunFolder
from bpn_shared.service import stop_on_signals
from bpn_shared.weights import Weights, decode_weights


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run_id", metavar="RUN", help="id of the run, or its beginning or end")
    parser.add_argument("--trials", type=int, default=10, help="episodes (default 10)")
    parser.add_argument(
        "--policy",
        choices=get_args(PlayedPolicy),
        default="greedy",
        help="the best action, drawn as in training, or any (default greedy)",
    )
    parser.add_argument("--version", type=int, help="weights version (default: the newest)")
    parser.add_argument("--seed", type=int, help="of starts and draws (default: the run's)")
    parser.add_argument("--pacing", choices=get_args(Pacing), default="lockstep")
    parser.add_argument(
        "--action-delay-ms",
        type=float,
        default=0.0,
        metavar="MS",
        help="time added between a frame and its action's effect; needs --pacing realtime",
    )
    parser.add_argument("--kernel", choices=get_args(Kernel), help="default: the run's")
    parser.add_argument("--robots", type=int, default=1, help="trials played side by side")
    parser.add_argument("--video", type=Path, metavar="FILE", help="film, .mp4 or .gif")
    parser.add_argument("--no-bars", action="store_true", help="film without action preferences")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="trajectories, .png or .svg")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Plays the trials; exit status 130 if interrupted."""
    folder = RunFolder.open(options.runs_dir, options.run_id)
    trials = _trials(options, folder.config())
    config, weights = trials.config(folder.config()), _weights(folder, options.version)
    video, plot = _media(options.video, options.plot)
    stop = stop_on_signals()
    with trials_bar(trials.count) as on_progress:
        episodes = play(folder, weights, trials, stop, on_progress)
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
        **summarize(config, [outcome(config, episode) for episode in episodes]),
    }
    if video is not None:
        video.write(options.video, episodes, config.task_spec, bars=not options.no_bars)
    if plot is not None:
        plot.write(options.plot, config.task, episodes)
    if options.json:
        print(json.dumps(result))
    else:
        _show(result, config)
    return 0


def _trials(options: argparse.Namespace, trained: RunConfig) -> Trials:
    if options.trials < 1:
        raise ConfigError(f"--trials = {options.trials} must be at least 1")
    changes = {
        "pacing": options.pacing,
        "action_delay_ms": options.action_delay_ms,
        "robots": options.robots,
        "kernel": options.kernel or trained.kernel,
    }
    seed = trained.seed if options.seed is None else options.seed
    return Trials(options.trials, options.policy, seed, changes)


def _weights(folder: RunFolder, version: int | None) -> Weights:
    if version is None:
        return folder.newest_weights()
    path = folder.weights_path(version)
    if not path.exists():
        raise ConfigError(
            f"--version {version}: not in {path.parent}, the newest is {folder.newest_weights().version}"
        )
    return decode_weights(path.read_bytes())


def _media(video_path: Path | None, plot_path: Path | None) -> tuple[Any, Any]:
    """The modules that write what is asked for: what is missing is said before the trials, not after."""
    video = plot = None
    if video_path is not None:
        _check_suffix("--video", video_path, (".mp4", ".gif"))
        video = optional.load("bpn.evaluation.video", extra="media", wanted_by="--video")
    if plot_path is not None:
        _check_suffix("--plot", plot_path, (".png", ".svg", ".pdf"))
        plot = optional.load("bpn.evaluation.plot", extra="media", wanted_by="--plot")
    return video, plot


def _check_suffix(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    if path.suffix not in suffixes:
        raise ConfigError(f"{option} {path}: the name must end with one of {', '.join(suffixes)}")


def _show(result: dict[str, Any], config: RunConfig) -> None:
    task = config.task_spec
    per_step = result["px_per_step" if task.rewards == "pixels" else "return_per_step"]["mean"]
    tracked, time = result.get("tracking_time"), ""
    if tracked is not None:
        time = f" = {tracked['seconds']:.1f} s ({tracked['percent']:.0f} %)"
    total, share = result[task.return_metric], result["success_share"]
    success = "n/a" if share is None else f"{100 * share:.0f} %"
    lines = [
        f"{result['trials']} {result['policy']} trials in {result['pacing']}, weights version "
        f"{result['weights_version']} of run {result['run_id']} ({config.algorithm}, {config.task})",
        f"return   {total['mean']:8.1f} ± {total['std']:.1f}{task.return_unit}"
        f"   ({per_step:.1f}{task.return_unit} a step)",
        f"length   {result['length']['mean']:8.1f} ± {result['length']['std']:.1f} of {config.steps} steps{time}",
        f"success  {success:>10}",
    ]
    if config.pacing == "realtime":
        lines.append(f"control periods without an action: {result['deadline_misses']}")
    Console().print("\n".join(lines), highlight=False, soft_wrap=True)
