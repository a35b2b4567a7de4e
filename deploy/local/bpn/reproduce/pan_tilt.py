"""Target `pan-tilt`: the paper's real-robot experiment, in simulation."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.evaluation.outcome import outcome, summarize
from bpn.evaluation.trajectories import figure_deg, gaze_deg
from bpn.evaluation.trials import PlayedPolicy, Trials
from bpn.plotting import BEST, OVER_SEEDS, band, colour, entitle, new_figure
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import (
    count,
    curves,
    full_length_shares,
    group,
    of_seeds,
    plus_minus,
)
from bpn_shared.config import RunConfig
from bpn_shared.runs.folder import RunFolder

PAPER_SECONDS = {"random": 0.9, "bqn": 1.9, "bpn": 11.6}
"""Table II."""
_TRIALS, _QUICK_TRIALS, _ROBOTS = 10, 2, 4
_START_SEED = 2
"""Of the trials' starts, which are the same for all."""
_DRAWN_TRIALS = 3


def plan(scope: Scope) -> list[RunConfig]:
    """BPN and BQN, one seed after the other."""
    return [
        scope.config("pan_tilt", algorithm=algorithm, seed=seed)
        for seed in range(scope.seeds)
        for algorithm in scope.algorithms
    ]


def measure(context: Context) -> dict[str, Any]:
    """Ten trials in realtime pacing with every run's last policy, and ten of random play.

    Returns:
        trials: for each of them name, seed, the evaluation's summary, and gaze_deg, the gaze in the first trials.
    """
    first = context.runs[0]
    played = [_play(context, first, "random", "random")]
    for folder in context.runs:
        played.append(_play(context, folder, "greedy", folder.config().algorithm))
    return {"trials": played}


def _play(context: Context, folder: RunFolder, policy: PlayedPolicy, name: str) -> dict[str, Any]:
    count = _QUICK_TRIALS if context.scope.quick else _TRIALS
    context.say(f"plays {count} trials of {name} (seed {folder.config().seed}) in realtime pacing")
    trials = Trials(
        count, policy, _START_SEED, {"pacing": "realtime", "robots": min(_ROBOTS, count)}
    )
    config = trials.config(folder.config())
    episodes = context.play(folder, trials)
    return {
        "name": name,
        "seed": folder.config().seed,
        **summarize(config, [outcome(config, episode) for episode in episodes]),
        "gaze_deg": [gaze_deg(episode).tolist() for episode in episodes[:_DRAWN_TRIALS]],
    }


def draw(document: Document) -> Figure:
    """Learning curves, lengths, and the gaze along the figure-8."""
    figure, (row,) = new_figure(1, 3, 15.0, 4.2)
    runs = [run | {"shares": full_length_shares(run)} for run in document["runs"]]
    names = list(group(runs, "algorithm"))
    for index, (algorithm,) in enumerate(names):
        seeds = [run for run in runs if run["algorithm"] == algorithm]
        label = algorithm.upper()
        band(row[0], curves(seeds, "returns_px"), label=label, index=index, style="-")
        band(row[1], curves(seeds, "shares"), label=label, index=index, style="-")
    row[0].set(xlabel="iteration", ylabel="return (px)", title="learning curves")
    row[1].set(xlabel="iteration", ylabel="share of full-length episodes", ylim=(-0.03, 1.03))
    row[0].legend(fontsize=8)
    _gaze(row[2], document, [name for (name,) in names])
    entitle(figure, document["title"], of=OVER_SEEDS)
    return figure


def _gaze(axes: Axes, document: Document, names: list[str]) -> None:
    axes.plot(*figure_deg().T, color=BEST, linewidth=4, alpha=0.25, label="the marker's figure-8")
    drawn = set()
    for trials in document["result"]["trials"]:
        if trials["name"] not in names or trials["name"] in drawn:
            continue
        drawn.add(trials["name"])
        for trial, path in enumerate(trials["gaze_deg"]):
            label = f"{trials['name'].upper()}, seed {trials['seed']}" if trial == 0 else None
            shade = colour(names.index(trials["name"]))
            axes.plot(*np.array(path).T, color=shade, linewidth=1.1, label=label)
    axes.set(xlabel="pan (degrees)", ylabel="tilt (degrees)", title="gaze of the first trials")
    axes.legend(fontsize=8)


def table(document: Document) -> str:
    """Tracking time as the paper's Table II, over all trials of all seeds."""
    rows = []
    for (name,), seeds in group(document["result"]["trials"], "name").items():
        seconds = of_seeds(seeds, [trials["tracking_time"]["seconds"] for trials in seeds])
        percent = np.mean([trials["tracking_time"]["percent"] for trials in seeds])
        kept = [success for trials in seeds for success in trials["successes"]]
        by_seed = ", ".join(f"{sum(t['successes'])}/{t['trials']}" for t in seeds)
        rows.append(
            [
                name.upper(), count(seeds), len(kept),
                f"{plus_minus(seconds)} ({percent:.0f})",
                f"{np.mean([t['length']['mean'] for t in seeds]):.1f}",
                f"{sum(kept)}/{len(kept)} ({by_seed})",
                f"{np.mean([t['return_px']['mean'] for t in seeds]):.1f}",
                sum(t["deadline_misses"] for t in seeds), PAPER_SECONDS.get(name, ""),
            ]
        )  # fmt: skip
    heading = [
        "policy", "seeds", "trials", "seconds (percent)", "steps", "kept to the end (by seed)",
        "return (px)", "deadline misses", "paper (s)",
    ]  # fmt: skip
    return markdown_table(heading, rows)


PAN_TILT = Target(
    name="pan-tilt",
    title="Pan-tilt in realtime pacing (the paper's Fig. 8 and Table II)",
    algorithms=("bpn", "bqn"),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
