"""How an observation s_t is made of frames: the last n, the first one repeated at an episode's start."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt


def frame_indices(step: int, frames_stacked: int) -> list[int]:
    """Indices of the frames in s_t, oldest first."""
    return [max(0, step - back) for back in reversed(range(frames_stacked))]


def stack(
    frames: Sequence[npt.NDArray[np.uint8]], step: int, frames_stacked: int
) -> npt.NDArray[np.uint8]:
    """s_t of an episode, uint8[frames_stacked * c, 84, 84], from its frames uint8[c, 84, 84]."""
    if frames_stacked == 1:
        return frames[step]
    return np.concatenate([frames[index] for index in frame_indices(step, frames_stacked)])
