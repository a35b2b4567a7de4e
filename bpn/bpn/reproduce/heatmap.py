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

from bpn.plotting import entitle, new_figure
from bpn.reproduce.caption import caption
from bpn.reproduce.definition import Context, Document, Scope, Target
from bpn.reproduce.markdown import mean_and_range
from bpn.reproduce.markdown import table as markdown_table
from bpn.reproduce.statistics import LAST, at_end, count, curves, group
from bpn_shared.spec.config import RunConfig

NODES = (16, 32, 100, 256)
ALPHAS = (0.0, 0.5, 0.8, 0.95)
_QUICK_ALPHAS = (0.0, 0.95)

_FORM = "{:.0f}"


def plan(scope: Scope) -> list[RunConfig]:
    """One run for each cell, one seed after the other."""
    alphas, sizes = (_QUICK_ALPHAS, NODES[:1]) if scope.quick else (ALPHAS, scope.sizes(NODES))
    return [
        scope.config("reaching", algorithm="bpn", seed=seed, hidden_units=hidden_units, alpha=alpha)
        for seed, hidden_units, alpha in product(scope.each_seed, sizes, alphas)
    ]


def measure(context: Context) -> dict[str, Any]:
    """Nothing beside the runs."""
    del context
    return {}


def cells(document: Document) -> list[dict[str, Any]]:
    """For each N and alpha: every panel's value of each seed.

    The paper's value is the best iteration's return, which hides what is lost again; beside it is what the
    run's end returned.
    """
    found = []
    for (hidden_units, alpha), seeds in group(document["runs"], "hidden_units", "alpha").items():
        returns = curves(seeds, "returns_px")
        values = {"best_return_px": returns.max(axis=1), "last_return_px": at_end(returns)}
        found.append(
            {"hidden_units": hidden_units, "alpha": alpha, "seeds": count(seeds), **values}
        )
    return sorted(found, key=lambda cell: (cell["hidden_units"], cell["alpha"]))


def _panels(document: Document) -> dict[str, str]:
    """Which values are shown, with their names."""
    last = min(LAST, *(len(run["returns_px"]) for run in document["runs"]))
    return {
        "best_return_px": "best iteration's return (px)",
        "last_return_px": f"return, last {last} iterations (px)",
    }


def draw(document: Document) -> Figure:
    """One map for each value; every cell with its mean and range."""
    found, panels = cells(document), _panels(document)
    figure, (row,) = new_figure(1, len(panels), 9.0, 4.4)
    for axes, (name, label) in zip(row, panels.items(), strict=True):
        _map(axes, found, name)
        axes.set_title(label, fontsize=10)
    how = "a cell: mean over seeds, in brackets from the lowest to the highest seed"
    entitle(figure, document["title"], of=caption(document, how))
    return figure


def _map(axes: Axes, found: list[dict[str, Any]], name: str) -> None:
    sizes = sorted({cell["hidden_units"] for cell in found})
    alphas = sorted({cell["alpha"] for cell in found})
    values: npt.NDArray[np.float64] = np.full((len(alphas), len(sizes)), np.nan)
    for cell in found:
        values[alphas.index(cell["alpha"]), sizes.index(cell["hidden_units"])] = cell[name].mean()
    image = axes.imshow(values, cmap="cividis", origin="lower", aspect="auto")
    middle = np.mean(image.get_clim())
    for cell in found:
        x, y = sizes.index(cell["hidden_units"]), alphas.index(cell["alpha"])
        ink = "black" if values[y, x] > middle else "white"
        text = mean_and_range(cell[name], _FORM).replace(" (", "\n(", 1)
        axes.text(x, y, text, ha="center", va="center", color=ink, fontsize=7)
    axes.set_xticks(range(len(sizes)), [str(size) for size in sizes])
    axes.set_yticks(range(len(alphas)), [f"{alpha:g}" for alpha in alphas])
    axes.set(xlabel="N", ylabel="alpha")
    axes.grid(visible=False)
    axes.figure.colorbar(image, ax=axes)


def table(document: Document) -> str:
    """Every cell."""
    panels = _panels(document)
    rows = [
        [
            cell["hidden_units"],
            f"{cell['alpha']:g}",
            cell["seeds"],
            *(mean_and_range(cell[name], _FORM) for name in panels),
        ]
        for cell in cells(document)
    ]
    heading = ["N", "alpha", "seeds", *panels.values()]
    return f"{markdown_table(heading, rows)}\n\nIn brackets: from the lowest to the highest seed."


HEATMAP = Target(
    name="heatmap",
    title="N and alpha on reaching (the paper's Fig. 6)",
    algorithms=("bpn",),
    plan=plan,
    measure=measure,
    draw=draw,
    table=table,
)
