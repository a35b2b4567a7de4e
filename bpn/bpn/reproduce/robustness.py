"""Targets `robustness` and `robustness-pan-tilt`: not of the paper; policies under a disturbed camera."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bpn.evaluation.outcome import outcome
from bpn.evaluation.trials import TrialPlan
from bpn.plotting import colour, entitle, new_figure
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import group
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

TRAINED_FOR = "noise=0..30,offset=-35..35,gain=0.65..1.35,salt_pepper=0..0.03"
"""A little more than is measured, so that what is measured is not the end of what was seen."""
LEVELS = (
    "", "noise=10", "noise=25", "noise=50", "offset=-30", "offset=30", "gain=0.7", "gain=1.3", "blur=1",
    "salt_pepper=0.02", "jpeg=30", "white_balance=0.2", "exposure=0.25", "backlash=2",
)  # fmt: skip
_TRIALS, _QUICK_TRIALS, _QUICK_LEVELS = 20, 2, 3
_START_SEED = 3
"""Of the trials' starts, which are the same for all."""


def plan(task: str, scope: Scope) -> list[RunConfig]:
    """Every algorithm with its preset, and with as many updates on pictures of which half are disturbed."""
    half = scope.config(task).epochs // 2
    return [
        scope.config(task, algorithm=algorithm, seed=seed, **changes)
        for seed in scope.each_seed
        for algorithm in (scope.algorithms[:1] if scope.quick else scope.algorithms)
        for changes in ({}, {"augment": TRAINED_FOR, "epochs": max(1, half)})
    ]


def measure(context: Context) -> dict[str, Any]:
    """Greedy trials of every run's last policy at every level.

    Returns:
        trained_for: the disturbances of half of the runs.
        trials: for each run and level algorithm, seed, augmented (its training), level, trials, kept (how many
            were played to their end) and return_px (mean).
    """
    levels = LEVELS[:_QUICK_LEVELS] if context.scope.quick else LEVELS
    return {
        "trained_for": TRAINED_FOR,
        "trials": [_play(context, folder, level) for folder in context.runs for level in levels],
    }


def _play(context: Context, folder: RunFolder, level: str) -> dict[str, Any]:
    config, count = folder.config(), _QUICK_TRIALS if context.scope.quick else _TRIALS
    context.say(
        f"plays {count} trials of {config.algorithm} (seed {config.seed}) under {level or 'nothing'}"
    )
    trials = TrialPlan(count, "greedy", _START_SEED, {"disturb": level})
    played = trials.config(config)
    outcomes = [outcome(played, episode) for episode in context.play(folder, trials)]
    return {
        "algorithm": config.algorithm,
        "seed": config.seed,
        "augmented": bool(config.augment),
        "level": level,
        "trials": count,
        "kept": sum(not one.terminated for one in outcomes),
        "return_px": round(float(np.mean([one.total for one in outcomes])), 2),
    }


def _shares(trials: list[dict[str, Any]]) -> dict[tuple[Any, ...], float]:
    """Percent of trials that were kept, by algorithm, training and level."""
    return {
        key: 100 * sum(one["kept"] for one in seeds) / sum(one["trials"] for one in seeds)
        for key, seeds in _by(trials).items()
    }


def draw(document: Document) -> Figure:
    """A group of bars for each level, a bar for each algorithm and training."""
    trials = document["result"]["trials"]
    shares, levels = _shares(trials), list(group(trials, "level"))
    kinds = list(group(trials, "algorithm", "augmented"))
    figure, ((axes,),) = new_figure(1, 1, 1.5 + 0.75 * len(levels), 4.2)
    width = 0.8 / len(kinds)
    for index, (algorithm, augmented) in enumerate(kinds):
        heights = [shares[algorithm, augmented, level] for (level,) in levels]
        places = np.arange(len(levels)) + (index - (len(kinds) - 1) / 2) * width
        axes.bar(
            places, heights, width, color=colour(index), label=_name(algorithm, augmented=augmented)
        )
    axes.set_xticks(
        range(len(levels)), [level or "none" for (level,) in levels], rotation=40, ha="right"
    )
    axes.set(ylim=(0, 103), ylabel="trials in which the target was kept (%)")
    entitle(figure, document["title"], of=caption(document, "share of all trials"), legend=[axes])
    return figure


def table(document: Document) -> str:
    """Disturbances downwards, algorithms and trainings to the right."""
    trials = document["result"]["trials"]
    shares, kinds = _shares(trials), list(group(trials, "algorithm", "augmented"))
    rows = [
        [
            level or "none",
            *(f"{shares[algorithm, augmented, level]:.0f}" for algorithm, augmented in kinds),
        ]
        for (level,) in group(trials, "level")
    ]
    heading = [
        "kept (% of trials)", *(_name(algorithm, augmented=augmented) for algorithm, augmented in kinds)
    ]  # fmt: skip
    returns = {
        key: float(np.mean([one["return_px"] for one in of])) for key, of in _by(trials).items()
    }
    clean = "; ".join(
        f"{_name(algorithm, augmented=augmented)} {returns[algorithm, augmented, '']:.0f} px"
        for algorithm, augmented in kinds
        if (algorithm, augmented, "") in returns
    )
    return (
        f"{markdown_table(heading, rows)}\n\nGreedy play from {trials[0]['trials']} starts for each seed; mean "
        f"return without disturbances: {clean}. Augmented: trained with half of the epochs and "
        f"`--augment {document['result']['trained_for']}`, so with as many updates."
    )


def _by(trials: list[dict[str, Any]]) -> dict[tuple[Any, ...], list[dict[str, Any]]]:
    return group(trials, "algorithm", "augmented", "level")


def _name(algorithm: str, *, augmented: bool) -> str:
    return f"{algorithm.upper()}, augmented" if augmented else algorithm.upper()


ROBUSTNESS = Target(
    name="robustness",
    title="Tracking with a disturbed camera (not of the paper)",
    algorithms=("bpn", "cvi", "dqn"),
    plan=partial(plan, "tracking"),
    measure=measure,
    draw=draw,
    table=table,
)
ROBUSTNESS_PAN_TILT = Target(
    name="robustness-pan-tilt",
    title="Pan-tilt with a disturbed camera (not of the paper)",
    algorithms=("bpn", "cvi", "dqn"),
    plan=partial(plan, "pan_tilt"),
    measure=measure,
    draw=draw,
    table=table,
)
