"""How an observation s_t is made of frames: the last n, the first one repeated at an episode's start.

Where a task asks for it, what changed since an earlier frame stands in that frame's place.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bpn_shared.spec.network import MAX_PIXEL


def frame_indices(step: int, frames_stacked: int) -> list[int]:
    """Indices of the frames in s_t, oldest first."""
    return [max(0, step - back) for back in reversed(range(frames_stacked))]


def stack(
    frames: Sequence[npt.NDArray[np.uint8]],
    step: int,
    frames_stacked: int,
    *,
    difference: bool = False,
) -> npt.NDArray[np.uint8]:
    """s_t of an episode, uint8[frames_stacked * c, rows, columns], from its frames uint8[c, rows, columns].

    Args:
        difference: whether each frame but the newest is replaced by what `changes` shows since then.
    """
    if frames_stacked == 1:
        return frames[step]
    seen = [frames[index] for index in frame_indices(step, frames_stacked)]
    if difference:
        seen = [*(changes(frame, seen[-1]) for frame in seen[:-1]), seen[-1]]
    return np.concatenate(seen)


def changes(earlier: npt.NDArray[np.uint8], newest: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """What changed between frames of one shape: 128 + 2 (newest - earlier), cut to 0..255.

    Twice, because what matters is small: what moves by less than a pixel changes it by a few levels.
    """
    change = newest.astype(np.int16) - earlier
    seen: npt.NDArray[np.uint8] = np.clip(128 + 2 * change, 0, MAX_PIXEL).astype(np.uint8)
    return seen
