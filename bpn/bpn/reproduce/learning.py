"""Targets `reaching` and `tracking`: the learning curves of the paper's simulation tasks."""

from functools import partial
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.plotting import OVER_SEEDS, band, entitle, new_figure, reference
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import mean_and_range
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import (
    LAST,
    at_end,
    count,
    curves,
    full_length_shares,
    group,
    of_seeds,
    shortfall_percent,
)
from bpn_robot_sim import baselines
from bpn_robot_sim.reaching.optimum import optimal_return, random_return
from bpn_robot_sim.robots import make_robot
from bpn_robot_sim.tracking.optimum import mean_optimal_return
from bpn_shared.runs.statistics import iqm
from bpn_shared.spec.config import RunConfig

BINARY, FLOAT = ("bpn", "bqn"), ("cvi", "dqn")
NODES = {"small": 32, "medium": 100, "large": 256}
"""N of the binary networks; the paper compares three and names none. A float network has the task's own."""

_STARTS = range(200)
_STYLES = {"bpn": "-", "bqn": "-", "cvi": "--", "dqn": ":"}
_TITLES = {"bpn": "BPN", "bqn": "BQN", "cvi": "CVI, float", "dqn": "DQN, float"}


def plan(task: str, scope: Scope) -> list[RunConfig]:
    """Every algorithm at every N, one seed after the other."""
    runs = []
    for seed in scope.each_seed:
        for algorithm in scope.algorithms:
            if algorithm in BINARY and not scope.quick:
                offered = scope.sizes(tuple(NODES.values()))
                sizes: list[dict[str, Any]] = [
                    {"hidden_units": hidden_units} for hidden_units in offered
                ]
            else:
                sizes = [{}]
            runs += [scope.config(task, algorithm=algorithm, seed=seed, **size) for size in sizes]
    return runs


def measure_reaching(context: Context) -> dict[str, Any]:
    """The optimum and random play, both exact."""
    steps = context.runs[0].config().steps
    return {
        "references": [
            {"name": "optimum", "return_px": optimal_return(steps), "full_length_share": 1.0},
            {"name": "random play", "return_px": random_return(steps), "full_length_share": 1.0},
        ]
    }


def measure_tracking(context: Context) -> dict[str, Any]:
    """The best that keeps the target, and play with the simulation's truth and at random, on the same starts."""
    steps = context.runs[0].config().steps
    robot = cast(baselines.Follower, make_robot("tracking"))
    best = {"name": "optimum", "return_px": mean_optimal_return(_STARTS, steps)}
    played = [best | {"length": steps, "full_length_share": 1.0}]
    for policy in ("greedy", "random"):
        episodes = [baselines.play(robot, policy, seed, steps) for seed in _STARTS]
        played.append(
            {
                "name": {"greedy": "greedy on the truth", "random": "random play"}[policy],
                "return_px": float(np.mean([one.return_px for one in episodes])),
                "length": float(np.mean([one.steps for one in episodes])),
                "full_length_share": 1 - float(np.mean([one.lost for one in episodes])),
            }
        )
    robot.close()
    return {"references": played}


def draw(document: Document) -> Figure:
    """A column for each N. Where episodes end early, their share of full length and the return of a step first.

    The return of such an episode says little by itself: nothing is paid for the steps that are missing.
    """
    runs = [_curves_of(run) for run in document["runs"]]
    sizes = sorted({run["hidden_units"] for run in runs if run["algorithm"] in BINARY}) or [0]
    rows = {"shares": "share of full-length episodes", "px_per_step": "return of a step (px)"}
    rows = (rows if _ends_early(runs) else {}) | {"returns_px": "return of an episode (px)"}
    width_in = max(5.7, 1.2 + 2.9 * len(sizes))
    figure, axes = new_figure(len(rows), len(sizes), width_in, 1.2 + 2.6 * len(rows))
    for column, hidden_units in enumerate(sizes):
        shown = [
            run for run in runs if run["algorithm"] in FLOAT or run["hidden_units"] == hidden_units
        ]
        axes[0][column].set_title(f"N = {hidden_units}")
        for one, name in zip((row[column] for row in axes), rows, strict=True):
            for (algorithm,), seeds in group(shown, "algorithm").items():
                index = (*BINARY, *FLOAT).index(algorithm)
                title, style = _TITLES[algorithm], _STYLES[algorithm]
                band(one, curves(seeds, name), label=title, index=index, style=style)
            _references(one, name, document["result"]["references"])
            if name == "shares":
                one.set_ylim(-0.03, 1.03)
    for row, label in zip(axes, rows.values(), strict=True):
        row[0].set_ylabel(label)
    for one in axes[-1]:
        one.set_xlabel("iteration")
    entitle(
        figure,
        document["title"],
        of=caption(document, OVER_SEEDS),
        legend=(one for row in axes for one in row),
    )
    return figure


def _curves_of(run: dict[str, Any]) -> dict[str, Any]:
    """The run's record with what is drawn and not recorded."""
    per_step = np.array(run["returns_px"]) / np.array(run["lengths"])
    return run | {"shares": full_length_shares(run), "px_per_step": per_step.tolist()}


def _ends_early(runs: list[dict[str, Any]]) -> bool:
    return any(any(run["failures"]) for run in runs)


def _references(axes: Axes, name: str, lines: list[dict[str, Any]]) -> None:
    """What the curves of returns, of an episode or of a step, are to be compared with."""
    for line, style in zip(lines, ("-", "--", ":"), strict=False):
        if name == "returns_px":
            reference(axes, line["return_px"], line["name"], style)
        elif name == "px_per_step" and "length" in line:
            reference(axes, line["return_px"] / line["length"], line["name"], style)


def table(document: Document) -> str:
    """What each algorithm returned over its last iterations, beside the baselines."""
    groups = group(document["runs"], "algorithm", "hidden_units")
    best = max(
        (_last_returns(seeds).mean() for (name, _), seeds in groups.items() if name == "cvi"),
        default=None,
    )
    best_iterations = not _ends_early(document["runs"])  # an early loss would be the best
    rows = []
    for (algorithm, hidden_units), seeds in groups.items():
        returns = _last_returns(seeds)
        shares = [100 * float(np.mean(full_length_shares(run)[-LAST:])) for run in seeds]
        rows.append(
            [
                _TITLES[algorithm], hidden_units, count(seeds), mean_and_range(returns), f"{iqm(returns):.1f}",
                mean_and_range(of_seeds(seeds, shares)), _worst(seeds, returns, of_seeds(seeds, shares)),
                f"{at_end(curves(seeds, 'lengths')).mean():.1f}",
                "" if best is None else f"{shortfall_percent(returns.mean(), best):+.1f} %",
                *([f"{curves(seeds, 'returns_px').mean(axis=0).max():.1f}"] if best_iterations else []),
            ]
        )  # fmt: skip
    for line in document["result"]["references"]:
        length = line.get("length")
        rows.append(
            [
                line["name"], "", "", f"{line['return_px']:.1f}", "",
                f"{100 * line['full_length_share']:.1f}", "", "" if length is None else f"{length:.1f}",
                "", *([""] if best_iterations else []),
            ]
        )  # fmt: skip
    last = min(LAST, *(len(run["returns_px"]) for run in document["runs"]))
    heading = [
        "", "N", "seeds", f"return, last {last} (px)", "interquartile mean", "full length (%)",
        "worst seed", "steps", "worse than CVI", *(["best iteration (px)"] if best_iterations else []),
    ]  # fmt: skip
    numbers = sorted({run["seed"] for run in document["runs"]})
    notes = (
        f"In brackets: from the lowest to the highest seed. Seeds: {', '.join(map(str, numbers))}. The worst one "
        "has the smallest share of full length, then the lowest return."
    )
    if document["target"] == "reaching":
        notes += " Every episode has the same start and the same target."
    if not best_iterations:
        notes += (
            " An episode that is lost early returns more, since nothing is paid for the steps that are missing. "
            f"The optimum keeps the target, mean of {len(_STARTS)} starts; ten episodes may have easier ones."
        )
    return f"{markdown_table(heading, rows)}\n\n{notes}"


def _worst(
    seeds: list[dict[str, Any]],
    returns: npt.NDArray[np.float64],
    shares: npt.NDArray[np.float64],
) -> int:
    """The seed with the lowest share of full length, among equals with the lowest return."""
    names = list(dict.fromkeys(run["seed"] for run in seeds))
    return int(names[np.lexsort((returns, shares))[0]])


def _last_returns(seeds: list[dict[str, Any]]) -> npt.NDArray[np.float64]:
    """Each seed's mean return of its last iterations."""
    return at_end(curves(seeds, "returns_px"))


REACHING = Target(
    name="reaching",
    title="Learning curves of reaching (the paper's Fig. 5a)",
    algorithms=(*BINARY, *FLOAT),
    plan=partial(plan, "reaching"),
    measure=measure_reaching,
    draw=draw,
    table=table,
)
TRACKING = Target(
    name="tracking",
    title="Learning curves of tracking (the paper's Fig. 5b)",
    algorithms=(*BINARY, *FLOAT),
    plan=partial(plan, "tracking"),
    measure=measure_tracking,
    draw=draw,
    table=table,
)
