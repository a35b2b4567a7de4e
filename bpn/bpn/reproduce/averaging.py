"""Target `averaging`: what alpha is for. Exact updates of reaching's table, with errors of known kind and size.

Needs no network and no run: with a table for P, an update has just the error that is put into it. So what CVI
makes of an error that changes from iteration to iteration, and of one that stays, is seen apart from all else.
"""

from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.plotting import colour, entitle, new_figure, reference
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import mean_and_range
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import LAST
from bpn_robot_sim.reaching.optimum import optimal_return
from bpn_robot_sim.reaching.tabular import Kind, Update, greedy_returns
from bpn_shared.spec.config import RunConfig

UPDATES: dict[str, float | None] = {
    "Q-learning (BQN's update)": None, "CVI, α = 0": 0.0, "CVI, α = 0.8": 0.8, "CVI, α = 0.95": 0.95,
}  # fmt: skip
SIGMAS = (0.0, 0.1, 0.3, 1.0, 3.0)
NODES = (16, 32, 100, 256)
KINDS: dict[Kind, str] = {
    "fresh": "an error that is fresh in each iteration",
    "staying": "the same error in all iterations",
}
_ITERATIONS, _QUICK_ITERATIONS = 50, 12


def plan(scope: Scope) -> list[RunConfig]:
    """Needs no run."""
    del scope
    return []


def measure(context: Context) -> dict[str, Any]:
    """Greedy play's return over the last ten iterations, for each seed of the errors.

    Returns:
        optimum_px, iterations; cells: lists of {update, kind, sigma, nodes, returns_px}.
    """
    iterations = _QUICK_ITERATIONS if context.scope.quick else _ITERATIONS
    cells = []
    for name, alpha in UPDATES.items():
        context.say(f"computes {name}")
        errors = [Update(alpha, sigma, kind) for kind, sigma in product(KINDS, SIGMAS)]
        for update in [*errors, *(Update(alpha, nodes=nodes) for nodes in NODES)]:
            seeds = range(context.scope.seeds if update.sigma else 1)
            ends = [greedy_returns(update, iterations, seed)[-LAST:].mean() for seed in seeds]
            cells.append(
                {
                    "update": name,
                    "kind": update.kind,
                    "sigma": update.sigma,
                    "nodes": update.nodes,
                    "returns_px": np.round(ends, 2).tolist(),
                }
            )
    return {"optimum_px": optimal_return(), "iterations": iterations, "cells": cells}


def draw(document: Document) -> Figure:
    """A panel for each kind of error: greedy return over the error's size, a curve for each update."""
    figure, (row,) = new_figure(1, len(KINDS), 9.0, 3.9)
    for axes, (kind, title) in zip(row, KINDS.items(), strict=True):
        axes.set_title(title, fontsize=9)
        for index, name in enumerate(UPDATES):
            _curve(axes, _cells(document, update=name, kind=kind, nodes=0), name, index)
        reference(axes, document["result"]["optimum_px"], "optimum", "-")
        axes.set(xlabel="σ of the error, in the unit of y")
        axes.set_xticks(range(len(SIGMAS)), [f"{sigma:g}" for sigma in SIGMAS])
    row[0].set_ylabel("greedy return (px)")
    result = document["result"]
    seeds = max(len(cell["returns_px"]) for cell in result["cells"])
    how = (
        f"mean of the last {LAST} of {result['iterations']} exact iterations; "
        f"line: mean of {seeds} seeds of the error; band: lowest to highest"
    )
    entitle(figure, document["title"], of=caption(document, how), legend=[row[0]])
    return figure


def _curve(axes: Axes, cells: list[dict[str, Any]], label: str, index: int) -> None:
    of_seeds = [cell["returns_px"] for cell in cells]
    places = range(len(cells))
    axes.plot(places, [np.mean(of) for of in of_seeds], "o-", color=colour(index), label=label)
    low, high = [min(of) for of in of_seeds], [max(of) for of in of_seeds]
    axes.fill_between(places, low, high, color=colour(index), alpha=0.15, linewidth=0)


def _cells(document: Document, **of: object) -> list[dict[str, Any]]:
    cells: list[dict[str, Any]] = document["result"]["cells"]
    return [cell for cell in cells if all(cell[name] == value for name, value in of.items())]


def table(document: Document) -> str:
    """A row for each error, a column for each update."""
    rows = []
    for kind, title in KINDS.items():
        for sigma in SIGMAS[1:]:
            found = _cells(document, kind=kind, sigma=sigma, nodes=0)
            rows.append([f"{title}, σ = {sigma:g}", *(_shown(cell) for cell in found)])
    none = _cells(document, kind="fresh", sigma=0.0, nodes=0)
    levels = [
        [f"none, but P has N+1 levels, N = {nodes}", *map(_shown, _cells(document, nodes=nodes))]
        for nodes in NODES
    ]
    rows = [["none", *map(_shown, none)], *levels, *rows]
    optimum = document["result"]["optimum_px"]
    return (
        f"{markdown_table(['error added to y', *UPDATES], rows)}\n\n"
        "Greedy return in px: mean over the seeds of the error, in brackets what they span; "
        f"optimum {optimum:.1f}. Reaching's 576 poses and 14 actions, γ, β and the rewards' scale of its preset."
    )


def _shown(cell: dict[str, Any]) -> str:
    return mean_and_range(cell["returns_px"])


AVERAGING = Target(
    "averaging",
    "What α is for: errors that change and errors that stay",
    (),
    plan,
    measure,
    draw,
    table,
)
