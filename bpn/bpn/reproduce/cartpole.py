"""Target `cartpole`: not of the paper; a Gymnasium environment that is learned from pixels alone."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bpn.evaluation.outcome import outcome, summarize
from bpn.evaluation.trials import PlayedPolicy, TrialPlan
from bpn.plotting import OVER_SEEDS, band, entitle, new_figure, reference
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import LAST, curves
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

TASK = "gym:CartPole-v1"
_TRIALS, _RANDOM_TRIALS, _QUICK_TRIALS = 20, 100, 2
_START_SEED = 2
"""Of the trials' starts, which are the same for all."""


def plan(scope: Scope) -> list[RunConfig]:
    """BPN with the preset, several seeds."""
    return scope.configs(TASK)


def measure(context: Context) -> dict[str, Any]:
    """Greedy trials of every run's last policy, and random play.

    Returns:
        trials: for each of them name, seed and the evaluation's summary.
    """
    played = [_play(context, context.runs[0], "random", "random", _RANDOM_TRIALS)]
    for folder in context.runs:
        played.append(_play(context, folder, "greedy", folder.config().algorithm, _TRIALS))
    return {"trials": played}


def _play(
    context: Context, folder: RunFolder, policy: PlayedPolicy, name: str, count: int
) -> dict[str, Any]:
    count = _QUICK_TRIALS if context.scope.quick else count
    context.say(f"plays {count} trials of {name} (seed {folder.config().seed})")
    trials = TrialPlan(count, policy, _START_SEED, {})
    config = trials.config(folder.config())
    outcomes = [outcome(config, episode) for episode in context.play(folder, trials)]
    return {"name": name, "seed": folder.config().seed, **summarize(config, outcomes)}


def draw(document: Document) -> Figure:
    """Learning curves beside random play."""
    figure, ((axes,),) = new_figure(1, 1, 6.5, 4.2)
    band(axes, curves(document["runs"], "returns"), label="BPN", index=0, style="-")
    random = document["result"]["trials"][0]
    reference(axes, random["return"]["mean"], "random play", "--")
    longest = _longest(document)
    axes.set(xlabel="iteration", ylabel=f"steps that the pole stands, of at most {longest}")
    entitle(figure, document["title"], of=caption(document, OVER_SEEDS), legend=[axes])
    return figure


def _longest(document: Document) -> int:
    """Environment steps of an episode at most: each pays 1, so this is the greatest return."""
    run = document["runs"][0]
    return int(run["steps"] * run["frame_skip"])


def table(document: Document) -> str:
    """Random play and every seed: the training return at the end, and greedy play."""
    random, *learned = document["result"]["trials"]
    last = min(LAST, *(len(run["returns"]) for run in document["runs"]))
    rows: list[list[object]] = [["random play", "", "", *_played(random)]]
    for run, trials in zip(document["runs"], learned, strict=True):
        rows.append(
            [
                f"BPN, seed {run['seed']}",
                f"{np.mean(run['returns'][-last:]):.1f}",
                f"{np.max(run['returns']):.1f}",
                *_played(trials),
            ]
        )
    heading = [
        "steps that the pole stands", f"training, last {last}", "best iteration", "greedy play",
        "shortest", "longest", "full length", "trials",
    ]  # fmt: skip
    actions, skip = (document["runs"][0][key] for key in ("steps", "frame_skip"))
    return (
        f"{markdown_table(heading, rows)}\n\nSteps are the environment's, each paying 1: at most "
        f"{_longest(document)}, which are {actions} actions of {skip} steps each. Full length: trials "
        "in which the pole stands to the end."
    )


def _played(trials: dict[str, Any]) -> list[object]:
    return [
        f"{trials['return']['mean']:.1f}",
        f"{min(trials['returns']):.0f}",
        f"{max(trials['returns']):.0f}",
        f"{sum(trials['successes'])}",
        trials["trials"],
    ]


CARTPOLE = Target(
    name="cartpole",
    title="CartPole from pixels through gym: (not of the paper)",
    algorithms=("bpn",),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
