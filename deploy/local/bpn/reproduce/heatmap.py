"""Target `heatmap`: how N and the GIO coefficient alpha decide what BPN learns of reaching.

The paper does not say of which task its map is. All episodes of reaching are equally long, so a return says all;
in tracking an early loss of the target would embellish it.
"""

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.plotting import OVER_SEEDS, entitle, new_figure
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import LAST, at_end, count, curves, group
from bpn_shared.config import RunConfig
from bpn_shared.statistics import mean_std

NODES = (16, 32, 100, 256)
ALPHAS = (0.0, 0.5, 0.8, 0.95)
_QUICK_ALPHAS = (0.0, 0.95)

_PANELS = (
    ("best_return_px", "best iteration's return (px)", "{:.0f}"),
    ("last_return_px", f"return, last {LAST} iterations (px)", "{:.0f}"),
)


def plan(scope: Scope) -> list[RunConfig]:
    """One run for each cell, one seed after the other."""
    alphas, sizes = (_QUICK_ALPHAS, NODES[:1]) if scope.quick else (ALPHAS, scope.sizes(NODES))
    return [
        scope.config("reaching", algorithm="bpn", seed=seed, nodes=nodes, alpha=alpha)
        for seed, nodes, alpha in product(range(scope.seeds), sizes, alphas)
    ]


def measure(context: Context) -> dict[str, Any]:
    """Nothing beside the runs."""
    del context
    return {}


def cells(document: Document) -> list[dict[str, Any]]:
    """For each N and alpha: the seeds' mean and standard deviation (None of one) of every panel's value.

    The paper's value is the best iteration's return, which hides what is lost again; beside it is what the
    run's end returned.
    """
    found = []
    for (nodes, alpha), runs in group(document["runs"], "nodes", "alpha").items():
        returns = curves(runs, "returns_px")
        values = {"best_return_px": returns.max(axis=1), "last_return_px": at_end(returns)}
        spread = {
            name: dict(zip(("mean", "std"), mean_std(of_seeds), strict=True))
            for name, of_seeds in values.items()
        }
        found.append({"nodes": nodes, "alpha": alpha, "seeds": count(runs), **spread})
    return sorted(found, key=lambda cell: (cell["nodes"], cell["alpha"]))


def draw(document: Document) -> Figure:
    """One map for each value; every cell with its mean and spread."""
    found = cells(document)
    figure, (row,) = new_figure(1, len(_PANELS), 10.0, 4.2)
    for axes, (name, label, form) in zip(row, _PANELS, strict=True):
        _map(axes, found, name, form)
        axes.set_title(label, fontsize=10)
    seeds = found[0]["seeds"]
    entitle(figure, document["title"], of=f"{OVER_SEEDS}, n = {seeds}")
    return figure


def _map(axes: Axes, found: list[dict[str, Any]], name: str, form: str) -> None:
    sizes = sorted({cell["nodes"] for cell in found})
    alphas = sorted({cell["alpha"] for cell in found})
    values: npt.NDArray[np.float64] = np.full((len(alphas), len(sizes)), np.nan)
    for cell in found:
        values[alphas.index(cell["alpha"]), sizes.index(cell["nodes"])] = cell[name]["mean"]
    image = axes.imshow(values, cmap="cividis", origin="lower", aspect="auto")
    middle = np.mean(image.get_clim())
    for cell in found:
        x, y = sizes.index(cell["nodes"]), alphas.index(cell["alpha"])
        ink = "black" if values[y, x] > middle else "white"
        axes.text(
            x, y, _spread(cell[name], form, "\n"), ha="center", va="center", color=ink, fontsize=9
        )
    axes.set_xticks(range(len(sizes)), [str(size) for size in sizes])
    axes.set_yticks(range(len(alphas)), [f"{alpha:g}" for alpha in alphas])
    axes.set(xlabel="N", ylabel="alpha")
    axes.grid(visible=False)
    axes.figure.colorbar(image, ax=axes)


def _spread(value: dict[str, Any], form: str, between: str = " ") -> str:
    std = "-" if value["std"] is None else form.format(value["std"])
    return f"{form.format(value['mean'])}{between}± {std}"


def table(document: Document) -> str:
    """Every cell."""
    rows = [
        [
            cell["nodes"], f"{cell['alpha']:g}", cell["seeds"],
            *(
                _spread(cell[name], form)
                for name, _, form in _PANELS
            ),
        ]
        for cell in cells(document)
    ]  # fmt: skip
    return markdown_table(["N", "alpha", "seeds", *(label for _, label, _ in _PANELS)], rows)


HEATMAP = Target(
    name="heatmap",
    title="N and alpha on reaching (the paper's Fig. 6)",
    algorithms=("bpn",),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
