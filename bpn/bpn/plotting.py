"""The look that all figures share: colours that colour-blind readers can tell apart, and no global state."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, without the yellow that vanishes on white."""
REFERENCE, BEST = "#888888", "#444444"
_DPI = 130
_MARGIN_IN = 0.1

OVER_SEEDS = "line: mean; band: lowest to highest seed"


def new_figure(
    rows: int, columns: int, width_in: float, height_in: float
) -> tuple[Figure, list[list[Axes]]]:
    """A figure and its axes, one list a row."""
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes: list[list[Axes]] = figure.subplots(rows, columns, squeeze=False).tolist()
    for one in (one for row in axes for one in row):
        one.spines[["top", "right"]].set_visible(False)
        one.grid(alpha=0.25, linewidth=0.6)
    return figure, axes


def colour(index: int) -> str:
    """The colour of the index-th curve."""
    return PALETTE[index % len(PALETTE)]


def band(
    axes: Axes, curves: npt.NDArray[np.float64], *, label: str, index: int, style: str
) -> None:
    """Mean over seeds and the range that they span, float64[seeds, iterations]; says n.

    The range, because a standard deviation around a mean reaches what cannot be: shares above 1, returns above 0.
    """
    x = np.arange(1, curves.shape[1] + 1)
    line = f"{label} (n = {len(curves)})"
    axes.plot(x, curves.mean(axis=0), style, color=colour(index), linewidth=1.6, label=line)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if len(curves) > 1:
        low, high = curves.min(axis=0), curves.max(axis=0)
        axes.fill_between(x, low, high, color=colour(index), alpha=0.15, linewidth=0)


def reference(axes: Axes, value: float, label: str, style: str) -> None:
    """A horizontal line to compare with."""
    shade = BEST if style == "-" else REFERENCE
    axes.axhline(value, linestyle=style, color=shade, linewidth=1.0, label=label)


def entitle(figure: Figure, title: str, *, of: str, legend: Iterable[Axes] = ()) -> None:
    """A title and what the numbers are `of`, both in lines that fit; below all, the legend of these axes.

    The legend has as many columns as the figure's width holds; what two axes name alike stands in it once.
    """
    figure.suptitle(f"{title}\n{of}", fontsize=10, wrap=True)
    entries = {
        label: handle
        for axes in legend
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if not entries:
        return
    room_px = (figure.get_figwidth() - 2 * _MARGIN_IN) * figure.dpi
    for columns in range(len(entries), 0, -1):
        below = figure.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=columns, fontsize=8
        )
        if columns == 1 or below.get_window_extent().width <= room_px:
            return
        below.remove()


def save(figure: Figure, path: Path) -> None:
    """Writes a PNG, or what else the suffix says."""
    figure.savefig(path)
