"""The trajectories of trials, as the paper's figure of the real robot shows them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bpn.evaluation.trajectories import (
    figure_deg,
    gaze_deg,
    seen_direction_deg,
    target_offsets_px,
)
from bpn.plotting import BEST, REFERENCE, colour, new_figure, save
from bpn_shared import plugins
from bpn_shared.errors import InputError
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.network import IMAGE_SIZE_PX
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.framing import MIDDLE_PX
from bpn_tasks.paths import reaching_path_px

MOST_TRIALS = 10
"""More would hide each other; the first are drawn."""


@dataclass(frozen=True, slots=True)
class Plot:
    """How trials of a task are drawn; a plug-in of the group bpn.plots.

    Attributes:
        size_in: of the figure, width and height.
        draw: the first trials, into its axes.
    """

    size_in: tuple[float, float]
    draw: Callable[[Axes, Sequence[Episode]], None]


def plot_of(task: TaskSpec) -> Plot:
    """How the task's trajectories are drawn.

    Raises:
        InputError: nobody knows how, or what does is not installed here.
    """
    if task.plot is None:
        raise InputError(f"--plot: no trajectories are known of task {task.name!r}; leave it out")
    plugin = plugins.find(plugins.PLOTS, task.plot)
    found = plugin.load()
    if not isinstance(found, Plot):
        raise plugin.broken(f"it is {type(found).__name__}, no Plot")
    return found


def write(path: Path, task: TaskSpec, episodes: Sequence[Episode]) -> None:
    """Draws the trials into a file.

    Raises:
        InputError: the task has no trajectories that could be drawn.
    """
    save(draw(task, episodes), path)


def draw(task: TaskSpec, episodes: Sequence[Episode]) -> Figure:
    """The trials' trajectories.

    Raises:
        InputError: the task has none that could be drawn.
    """
    plot = plot_of(task)
    figure, ((axes,),) = new_figure(1, 1, *plot.size_in)
    plot.draw(axes, episodes[:MOST_TRIALS])
    return figure


def hand_path(axes: Axes, episodes: Sequence[Episode]) -> None:
    """Reaching: the hand's way to the target in the image."""
    for index, episode in enumerate(episodes):
        target_px, hands_px = reaching_path_px(episode.frames)
        axes.plot(*hands_px.T, "o-", color=colour(index), markersize=3, linewidth=1.2)
        if index == 0:
            axes.plot(*target_px, "*", color=BEST, markersize=16, label="target")
            axes.plot(*hands_px[0], "s", color=BEST, markersize=7, label="start")
    axes.set(
        xlim=(0, IMAGE_SIZE_PX), ylim=(IMAGE_SIZE_PX, 0), aspect="equal",
        xlabel="x in the image (px)", ylabel="y in the image (px)",
        title=f"hand paths of {len(episodes)} trials",
    )  # fmt: skip
    axes.legend(fontsize=8)


def target_offset(axes: Axes, episodes: Sequence[Episode]) -> None:
    """Tracking: the target's horizontal place in the frame; a cross where it was lost."""
    for index, episode in enumerate(episodes):
        x_px = target_offsets_px("tracking", episode)[:, 0]
        axes.plot(x_px, color=colour(index), linewidth=1.2)
        if episode.meta.terminated:
            axes.plot(len(x_px) - 1, x_px[-1], "x", color=colour(index), markersize=9, mew=2)
    for edge_px in (-MIDDLE_PX, MIDDLE_PX):
        axes.axhline(edge_px, color=REFERENCE, linestyle="--", linewidth=1.0)
    lost = sum(episode.meta.terminated for episode in episodes)
    axes.set(
        xlabel="step", ylabel="target from the frame's middle, x (px)",
        title=f"{len(episodes)} trials, {lost} lost (x); dashed: the frame's border",
    )  # fmt: skip


def figure_eight(axes: Axes, episodes: Sequence[Episode]) -> None:
    """Pan-tilt: where the camera pointed beside the marker's figure-8; a cross where the marker was lost."""
    axes.plot(*figure_deg().T, color=BEST, linewidth=4, alpha=0.25, label="the marker's figure-8")
    for index, episode in enumerate(episodes):
        gaze = gaze_deg(episode)
        axes.plot(*gaze.T, color=colour(index), linewidth=1.1)
        if episode.meta.terminated:
            offsets_px = target_offsets_px("pan_tilt", episode)
            lost_at = seen_direction_deg(gaze[-1:], offsets_px[-1:])[0]
            axes.plot(*lost_at, "x", color=colour(index), markersize=9, mew=2)
    lost = sum(episode.meta.terminated for episode in episodes)
    axes.set(
        xlabel="pan (degrees)", ylabel="tilt (degrees)", aspect="equal",
        title=f"gaze in {len(episodes)} trials, {lost} lost the marker (x)",
    )  # fmt: skip
    axes.legend(fontsize=8)


HAND_PATH = Plot((5.0, 5.0), hand_path)
TARGET_OFFSET = Plot((7.0, 4.0), target_offset)
FIGURE_EIGHT = Plot((6.5, 4.5), figure_eight)
