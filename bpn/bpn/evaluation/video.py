"""A film of trials: what the camera sees, beside the preferences of every action."""

from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import numpy.typing as npt

from bpn_shared.messages.episode import Episode
from bpn_shared.spec.tasks import TaskSpec

Picture = npt.NDArray[np.uint8]

SCALE = 4
_BARS_WIDTH_PX, _GAP_PX, _BETWEEN_PX = 128, 16, 4
_BACKGROUND, _BAR, _CHOSEN = (24, 24, 28), (120, 130, 145), (230, 159, 0)


def write(path: Path, episodes: Sequence[Episode], task: TaskSpec, *, bars: bool = True) -> None:
    """Writes the episodes one after the other, at the robot's speed.

    Args:
        path: an .mp4 or .gif file.
        bars: beside the picture, a bar for each action's preference; the applied action's is coloured. Of several
            dimensions, a bar for each choice, with room between the dimensions.
    """
    pictures = np.stack(
        [picture for one in episodes for picture in pictures_of(one, task, bars=bars)]
    )
    # Through memory: a writer that fails at a file complains of it once more, by itself, when it is collected.
    if path.suffix.lower() == ".gif":
        film = imageio.imwrite(
            "<bytes>", pictures, extension=".gif", duration=1000 * task.control_period_s, loop=0
        )
    else:
        film = imageio.imwrite(
            "<bytes>", pictures, extension=".mp4", fps=1 / task.control_period_s, macro_block_size=1
        )
    path.write_bytes(film)


def pictures_of(episode: Episode, task: TaskSpec, *, bars: bool = True) -> Iterator[Picture]:
    """One RGB picture uint8[h, w, 3] for each of the episode's T+1 frames; h and w are even."""
    for step, frame in enumerate(episode.frames):
        picture = _enlarged(frame)
        if bars:
            last = min(step, episode.steps - 1)  # the last frame has no action of its own
            panel = _bars(
                episode.outputs[last], _taken(episode, last, task), picture.shape[0], task.dims
            )
            picture = np.hstack([picture, panel])
        yield picture


def _enlarged(frame: Picture) -> Picture:
    """uint8[c, h, w] of one or three planes, as RGB, `SCALE` times as large."""
    rgb = np.broadcast_to(frame, (3, *frame.shape[1:])).transpose(1, 2, 0)
    return rgb.repeat(SCALE, axis=0).repeat(SCALE, axis=1)


def _taken(episode: Episode, step: int, task: TaskSpec) -> set[int]:
    """The outputs of the applied action, one of each dimension."""
    starts = accumulate(task.dims[:-1], initial=0)
    choices = np.atleast_1d(episode.actions[step]).tolist()
    return {start + choice for start, choice in zip(starts, choices, strict=True)}


def _bars(
    outputs: npt.NDArray[np.generic], applied: set[int], height_px: int, dims: Sequence[int]
) -> Picture:
    """One horizontal bar an action, from the top; the longest is the most preferred."""
    panel = np.full((height_px, _BARS_WIDTH_PX, 3), _BACKGROUND, np.uint8)
    values = outputs.astype(np.float64)
    span = max(float(np.ptp(values)), 1e-9)
    room_px = _BARS_WIDTH_PX - 2 * _GAP_PX
    firsts = set(accumulate(dims[:-1]))
    edges = np.linspace(_GAP_PX, height_px - _GAP_PX, len(values) + 1).astype(int)
    for action, (top, bottom) in enumerate(pairwise(edges)):
        length_px = 2 + round((room_px - 2) * float(values[action] - values.min()) / span)
        colour = _CHOSEN if action in applied else _BAR
        begin = top + 1 + _BETWEEN_PX * (action in firsts)
        panel[begin : bottom - 1, _GAP_PX : _GAP_PX + length_px] = colour
    return panel
