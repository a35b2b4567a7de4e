"""The look that all figures share: colours that colour-blind readers can tell apart, and no global state."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, without the yellow that vanishes on white."""
REFERENCE, BEST = "#888888", "#444444"
_DPI = 130

OVER_SEEDS = "mean ± standard deviation over seeds"


def new_figure(
    rows: int, columns: int, width_in: float, height_in: float
) -> tuple[Figure, list[list[Axes]]]:
    """A figure and its axes, one list a row."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
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
    """Mean over seeds with one standard deviation (n - 1) around it, float64[seeds, iterations]; says n."""
    x = np.arange(1, curves.shape[1] + 1)
    mean = curves.mean(axis=0)
    line = f"{label} (n = {len(curves)})"
    axes.plot(x, mean, style, color=colour(index), linewidth=1.6, label=line)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if len(curves) > 1:
        std = curves.std(axis=0, ddof=1)
        axes.fill_between(x, mean - std, mean + std, color=colour(index), alpha=0.15, linewidth=0)


def reference(axes: Axes, value: float, label: str, style: str) -> None:
    """A horizontal line to compare with."""
    shade = BEST if style == "-" else REFERENCE
    axes.axhline(value, linestyle=style, color=shade, linewidth=1.0, label=f"{label} ({value:.0f})")


def entitle(figure: Figure, title: str, *, of: str, legend: Axes | None = None) -> None:
    """A title and what the numbers are `of`; if axes are given, their legend below the whole figure."""
    figure.suptitle(f"{title}\n{of}", fontsize=10)
    if legend is not None:
        handles, labels = legend.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)


def save(figure: Figure, path: Path) -> None:
    """Writes a PNG, or what else the suffix says."""
    figure.savefig(path, dpi=_DPI)
