"""What figures must hold whatever is drawn: nothing beyond their edges, nothing beyond what is possible."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from reproduced import made, record

from bpn.plotting import band, entitle, new_figure, reference
from bpn.reproduce.caption import QUICK
from bpn.reproduce.markdown import mean_and_range
from bpn.reproduce.targets import TARGETS

WIDTHS_IN = st.floats(5.0, 12.0)
LABELS = st.lists(st.text("abcdefgh -", min_size=1, max_size=40), max_size=9, unique=True)


def check_inside(figure: Figure) -> None:
    """Title, legends and axes with all that is written at them are within the figure, to a pixel."""
    figure.canvas.draw()
    titles = [text for text in figure.texts if text.get_text()]
    for artist in (*titles, *figure.legends, *figure.axes):
        box = artist.get_tightbbox()
        assert box.x0 >= -1, artist
        assert box.y0 >= -1, artist
        assert box.x1 <= figure.bbox.width + 1, artist
        assert box.y1 <= figure.bbox.height + 1, artist
        if artist in figure.axes:
            assert min(artist.bbox.width, artist.bbox.height) > 15  # not squeezed to nothing


@settings(max_examples=12)
@given(WIDTHS_IN, LABELS, st.integers(1, 3))
@example(5.7, [f"greedy on the truth ({number})" for number in range(4)], 1)
@example(5.0, ["a label that is nearly as long as its page is wide", "b", "c"], 2)
def test_title_and_legend_are_inside_the_figure(
    width_in: float, labels: list[str], columns: int
) -> None:
    figure, (row,) = new_figure(1, columns, width_in, 4.0)
    for axes in row:
        for label in labels:
            reference(axes, 1.0, label, "-")
    entitle(figure, "A title of a few words", of="line: mean over seeds; " * 5, legend=row)
    check_inside(figure)
    shown = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert sorted(shown) == sorted(labels)  # once each, however many axes


@pytest.mark.parametrize("algorithms", [("bpn",), ("bpn", "bqn", "cvi", "dqn")])
@pytest.mark.parametrize("sizes", [(32,), (32, 100), (32, 100, 256)])
@pytest.mark.parametrize("name", ["reaching", "tracking"])
def test_learning_figures_fit_for_any_algorithms_and_nodes(
    name: str, sizes: tuple[int, ...], algorithms: tuple[str, ...]
) -> None:
    document = made(name, quick=True)
    document["runs"] = [
        record(algorithm, hidden_units, seed, lost=seed)
        for algorithm in algorithms
        for hidden_units in sizes
        for seed in range(3)
    ]
    lines = document["result"]["references"]
    document["result"]["references"] = [
        lines[0] | {"name": each} for each in ("optimum", "greedy on the truth", "random play")
    ]
    check_inside(TARGETS[name].draw(document))


@pytest.mark.parametrize("name", TARGETS)
def test_every_figure_fits_and_says_when_it_is_a_quick_version(name: str) -> None:
    for quick in (False, True):
        figure = TARGETS[name].draw(made(name, quick=quick))
        check_inside(figure)
        assert (QUICK in figure.get_suptitle()) is quick


@given(
    arrays.arrays(
        np.float64,
        st.tuples(st.integers(1, 6), st.integers(1, 12)),
        elements=st.floats(0.0, 1.0, width=32),
    )
)
def test_a_band_reaches_nothing_that_no_seed_had(curves: Any) -> None:
    _, ((axes,),) = new_figure(1, 1, 5.0, 4.0)
    band(axes, curves, label="share", index=0, style="-")
    bands = axes.findobj(PolyCollection)
    assert len(bands) == (len(curves) > 1)
    for one in bands:
        heights = one.get_paths()[0].vertices[:, 1]
        assert heights.min() == curves.min()
        assert heights.max() == curves.max()


@given(st.lists(st.floats(-1000, 0), min_size=1, max_size=6))
def test_a_spread_over_seeds_is_within_what_seeds_had(values: list[float]) -> None:
    text = mean_and_range(values)
    numbers = [float(word.strip("()")) for word in text.split() if word != "to"]
    if len(numbers) == 1:
        assert max(values) - min(values) <= 0.1
    else:
        mean, low, high = numbers
        assert low <= mean <= high
        assert (low, high) == (round(min(values), 1), round(max(values), 1))
