"""What a camera gives: one picture of the size that every policy sees."""

import numpy as np
import numpy.typing as npt

Frame = npt.NDArray[np.uint8]
"""[channels, rows, columns]."""


def is_flat(frame: Frame) -> bool:
    """Whether the whole frame, uint8[c, rows, columns], has one colour: such a camera shows nothing."""
    return bool((frame == frame[:, :1, :1]).all())
