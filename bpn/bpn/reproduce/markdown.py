"""Markdown tables."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt


def table(heading: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table whose first column is aligned left and all others right."""
    lines = [
        " | ".join(map(str, row)) for row in (heading, ["---", *["---:"] * (len(heading) - 1)])
    ]
    lines += [" | ".join(map(str, row)) for row in rows]
    return "\n".join(f"| {line} |" for line in lines)


def mean_and_range(values: npt.ArrayLike, form: str = "{:.1f}") -> str:
    """Mean of one value for each seed, and the range that they span; where all are equal their value alone.

    A handful of seeds allows no more, and a range never reaches what cannot be.
    """
    of_seeds = np.asarray(values, np.float64)
    mean = form.format(of_seeds.mean())
    low, high = (form.format(end) for end in (of_seeds.min(), of_seeds.max()))
    return mean if low == high else f"{mean} ({low} to {high})"
