"""Target `pan-tilt`: the paper's real-robot experiment, in simulation."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.evaluation.outcome import outcome, summarize
from bpn.evaluation.trajectories import figure_deg, gaze_deg
from bpn.evaluation.trials import PlayedPolicy, TrialPlan
from bpn.plotting import BEST, OVER_SEEDS, band, colour, entitle, new_figure
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import mean_and_range
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import count, curves, full_length_shares, group, of_seeds
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

PAPER_SECONDS = {"random": 0.9, "bqn": 1.9, "bpn": 11.6}
"""Table II."""
_TRIALS, _QUICK_TRIALS, _ROBOTS = 10, 2, 4
_START_SEED = 2
"""Of the trials' starts, which are the same for all."""
_DRAWN_TRIALS = 3


def plan(scope: Scope) -> list[RunConfig]:
    """BPN and BQN, one seed after the other."""
    return scope.configs("pan_tilt")


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
    trials = TrialPlan(
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
    """Learning curves, the share first; below them the gaze along the figure-8, of each algorithm."""
    runs = [run | {"shares": full_length_shares(run)} for run in document["runs"]]
    names = [name for (name,) in group(runs, "algorithm")]
    figure, (learning, gazes) = new_figure(2, 2, 7.4, 6.6)
    for index, name in enumerate(names):
        seeds = [run for run in runs if run["algorithm"] == name]
        for axes, values in zip(learning, ("shares", "returns_px"), strict=True):
            band(axes, curves(seeds, values), label=name.upper(), index=index, style="-")
    learning[0].set(xlabel="iteration", ylabel="share of full-length episodes", ylim=(-0.03, 1.03))
    learning[1].set(xlabel="iteration", ylabel="return of an episode (px)")
    for index, (axes, name) in enumerate(zip(gazes, names, strict=False)):
        _gaze(axes, document["result"]["trials"], name, index)
    for unused in gazes[len(names) :]:
        unused.remove()
    entitle(
        figure,
        document["title"],
        of=caption(document, OVER_SEEDS),
        legend=(learning[0], *gazes[: len(names)]),
    )
    return figure


def _gaze(axes: Axes, trials: list[dict[str, Any]], name: str, index: int) -> None:
    """Where the camera pointed in the first trials of the algorithm's first seed."""
    axes.plot(*figure_deg().T, color=BEST, linewidth=4, alpha=0.25, label="the marker's figure-8")
    played = next(one for one in trials if one["name"] == name)
    for path in played["gaze_deg"]:
        axes.plot(*np.array(path).T, color=colour(index), linewidth=1.0)
    what = f"{name.upper()}'s gaze, seed {played['seed']}, {len(played['gaze_deg'])} trials"
    axes.set_title(what, fontsize=9)
    axes.set(xlabel="pan (degrees)", ylabel="tilt (degrees)")


def table(document: Document) -> str:
    """Tracking time as the paper's Table II, over all trials of all seeds."""
    rows = []
    for (name,), seeds in group(document["result"]["trials"], "name").items():
        kept = [success for trials in seeds for success in trials["successes"]]
        by_seed = ", ".join(f"{sum(t['successes'])}/{t['trials']}" for t in seeds)
        rows.append(
            [
                name.upper(), count(seeds), len(kept),
                mean_and_range(of_seeds(seeds, [t["tracking_time"]["seconds"] for t in seeds])),
                f"{np.mean([trials['tracking_time']['percent'] for trials in seeds]):.0f}",
                f"{np.mean([t['length']['mean'] for t in seeds]):.1f}",
                f"{sum(kept)}/{len(kept)}" + (f" ({by_seed})" if len(seeds) > 1 else ""),
                f"{np.mean([t['return_px']['mean'] for t in seeds]):.1f}",
                sum(t["deadline_misses"] for t in seeds), PAPER_SECONDS.get(name, ""),
            ]
        )  # fmt: skip
    heading = [
        "policy", "seeds", "trials", "seconds", "percent", "steps", "kept to the end",
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
