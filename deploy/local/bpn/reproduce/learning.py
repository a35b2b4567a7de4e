"""Targets `reaching` and `tracking`: the learning curves of the paper's simulation tasks."""

from functools import partial
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from bpn.plotting import OVER_SEEDS, band, entitle, new_figure, reference
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import (
    LAST,
    at_end,
    count,
    curves,
    full_length_shares,
    group,
    of_seeds,
    plus_minus,
    shortfall_percent,
)
from bpn_robot_sim import references
from bpn_robot_sim.reaching.optimum import optimal_return, random_return
from bpn_robot_sim.robot import make_robot
from bpn_robot_sim.tracking.optimum import mean_optimal_return
from bpn_shared.config import RunConfig
from bpn_shared.statistics import iqm

BINARY, FLOAT = ("bpn", "bqn"), ("cvi", "dqn")
NODES = {"small": 32, "medium": 100, "large": 256}
"""N of the binary networks; the paper compares three and names none. A float network has the task's own."""

_STARTS = range(200)
_STYLES = {"bpn": "-", "bqn": "-", "cvi": "--", "dqn": ":"}
_TITLES = {"bpn": "BPN", "bqn": "BQN", "cvi": "CVI, float", "dqn": "DQN, float"}


def plan(task: str, scope: Scope) -> list[RunConfig]:
    """Every algorithm at every N, one seed after the other."""
    runs = []
    for seed in range(scope.seeds):
        for algorithm in scope.algorithms:
            if algorithm in BINARY and not scope.quick:
                offered = scope.sizes(tuple(NODES.values()))
                sizes: list[dict[str, Any]] = [{"nodes": nodes} for nodes in offered]
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
    robot = cast(references.Follower, make_robot("tracking"))
    best = {"name": "optimum", "return_px": mean_optimal_return(_STARTS, steps)}
    played = [best | {"length": steps, "full_length_share": 1.0}]
    for policy in ("greedy", "random"):
        episodes = [references.play(robot, policy, seed, steps) for seed in _STARTS]
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
    """Returns over iterations, a column for each N; below them the share of full-length episodes."""
    runs = [run | {"shares": full_length_shares(run)} for run in document["runs"]]
    sizes = sorted({run["nodes"] for run in runs if run["algorithm"] in BINARY}) or [0]
    ends_early = any(any(run["failures"]) for run in runs)
    rows = [("returns_px", "return (px)")]
    rows += [("shares", "share of full-length episodes")] if ends_early else []
    figure, axes = new_figure(len(rows), len(sizes), 1.5 + 4.2 * len(sizes), 1.2 + 3.0 * len(rows))
    for column, nodes in enumerate(sizes):
        shown = [run for run in runs if run["algorithm"] in FLOAT or run["nodes"] == nodes]
        for row, (name, label) in enumerate(rows):
            one = axes[row][column]
            for (algorithm,), seeds in group(shown, "algorithm").items():
                index = (*BINARY, *FLOAT).index(algorithm)
                title, style = _TITLES[algorithm], _STYLES[algorithm]
                band(one, curves(seeds, name), label=title, index=index, style=style)
            one.set(xlabel="iteration", ylabel=label, title=f"N = {nodes}")
        for line, style in zip(document["result"]["references"], ("-", "--", ":"), strict=False):
            reference(axes[0][column], line["return_px"], line["name"], style)
    if ends_early:
        for one in axes[1]:
            one.set_ylim(-0.03, 1.03)
    entitle(figure, document["title"], of=OVER_SEEDS, legend=axes[0][0])
    return figure


def table(document: Document) -> str:
    """What each algorithm returned over its last iterations, beside the references."""
    groups = group(document["runs"], "algorithm", "nodes")
    best = max(
        (_end(seeds)[0].mean() for (name, _), seeds in groups.items() if name == "cvi"),
        default=None,
    )
    rows = []
    for (algorithm, nodes), seeds in groups.items():
        returns, share, length = _end(seeds)
        rows.append(
            [
                _TITLES[algorithm], nodes, count(seeds), plus_minus(returns), f"{iqm(returns):.1f}",
                f"{100 * share:.1f} %", f"{length:.1f}",
                "" if best is None else f"{shortfall_percent(returns.mean(), best):+.1f} %",
                f"{curves(seeds, 'returns_px').mean(axis=0).max():.1f}",
            ]
        )  # fmt: skip
    for line in document["result"]["references"]:
        rows.append(
            [
                line["name"], "", "", f"{line['return_px']:.1f}", "",
                f"{100 * line['full_length_share']:.1f} %", line.get("length", ""), "", "",
            ]
        )  # fmt: skip
    last = min(LAST, *(len(run["returns_px"]) for run in document["runs"]))
    heading = [
        "", "N", "seeds", f"return, last {last} (px)", "interquartile mean", "full length",
        "steps", "worse than CVI", "best iteration (px)",
    ]  # fmt: skip
    return markdown_table(heading, rows)


def _end(runs: list[dict[str, Any]]) -> tuple[npt.NDArray[np.float64], float, float]:
    """Of the last iterations: each seed's return, mean share of full-length episodes and mean length."""
    shares = of_seeds(runs, [float(np.mean(full_length_shares(run)[-LAST:])) for run in runs])
    lengths = at_end(curves(runs, "lengths"))
    return at_end(curves(runs, "returns_px")), float(shares.mean()), float(lengths.mean())


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
