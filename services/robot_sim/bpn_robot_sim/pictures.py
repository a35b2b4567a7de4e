"""What counts as a picture, and pictures as frames: nothing that looks like one is taken on trust."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from PIL import Image

from bpn_robot.frame import Frame, is_flat
from bpn_shared.spec.network import IMAGE_SIZE_PX

Picture = npt.NDArray[np.uint8]

LEAST_CONTRAST = 16
"""Levels of 255 between the darkest and the brightest of all pixels of a probe; less is taken for black."""
_GRAY_RGB = (1, 3)
_RGBA = 4


class PictureError(ValueError):
    """What was seen is no picture; the message says what it is."""


def as_frame(picture: Picture, channels: int) -> Frame:
    """A picture uint8[height, width] or [height, width, 1, 3 or 4] as uint8[channels, 84, 84].

    Each pixel is the mean of the area that it covers, so that motion below a pixel is still seen.
    """
    image = Image.fromarray(picture.squeeze(-1) if picture.shape[2:] == (1,) else picture)
    image = image.convert("L" if channels == 1 else "RGB")
    small = np.asarray(image.resize((IMAGE_SIZE_PX, IMAGE_SIZE_PX), Image.Resampling.BOX))
    planes = small[np.newaxis] if channels == 1 else small.transpose(2, 0, 1)
    return np.ascontiguousarray(planes)


def rendered(picture: Any) -> Picture:
    """What `render()` returned, as uint8[height, width] or [height, width, 1, 3 or 4 (RGBA)].

    Raises:
        PictureError: it is no array, of another shape, or its values are neither uint8 nor floats in 0..1.
    """
    if not isinstance(picture, np.ndarray):
        several = f" of {len(picture)}" if isinstance(picture, list | tuple) else ""
        raise PictureError(f"a {type(picture).__name__}{several} where a picture is expected")
    if picture.ndim not in (2, 3) or picture.shape[2:] not in ((), (1,), (3,), (_RGBA,)):
        raise PictureError(
            f"{described(picture)} where [height, width] or [height, width, 1, 3 or 4] is expected"
        )
    return picture if picture.dtype == np.uint8 else _brightness(picture)


class ObservedPictures:
    """Observations of a space whose every value is a picture.

    Args:
        space: Box of two or three axes; channels, 1 or 3, come last or first.

    Raises:
        PictureError: the space's values are no pictures, or it cannot be told which they are.
    """

    def __init__(self, space: Any) -> None:
        if not isinstance(space, Box) or len(space.shape) not in (2, 3):
            raise PictureError(f"its observations are no images ({space})")
        self._low, self._high = float(np.min(space.low)), float(np.max(space.high))
        shares = np.issubdtype(space.dtype, np.floating) and (self._low, self._high) == (0.0, 1.0)
        if not (shares or (space.dtype == np.uint8 and self._low < self._high)):
            raise PictureError(
                f"its observations ({space}) are neither uint8 nor floats in 0..1, so their values are "
                "no levels of brightness"
            )
        self._shape, self._dtype = space.shape, space.dtype
        self._channels_first = _channels_first(space)

    def picture(self, observation: Any) -> Picture:
        """One observation, as uint8[height, width] or [height, width, 1 or 3].

        Values of the space's own range, such as 0..10, become 0..255.

        Raises:
            PictureError: it is not of its space.
        """
        array = np.asarray(observation)
        if array.shape != self._shape or array.dtype != self._dtype:
            expected = f"{self._dtype}{list(self._shape)}"
            raise PictureError(f"an observation {described(array)}, its space has {expected}")
        picture = array.transpose(1, 2, 0) if self._channels_first else array
        if self._dtype != np.uint8:
            return _brightness(picture)
        if (self._low, self._high) == (0.0, 255.0):
            return picture
        levels = (picture - self._low) / (self._high - self._low)
        if not (levels.min() >= 0.0 and levels.max() <= 1.0):
            raise PictureError(f"an observation outside its space's {self._low:g}..{self._high:g}")
        return _brightness(levels)


def _channels_first(space: Box) -> bool:
    if len(space.shape) == 2 or space.shape[2] in _GRAY_RGB:
        return False
    if space.shape[0] in _GRAY_RGB:
        return True
    raise PictureError(
        f"its observations ({space}) have neither 1 (gray) nor 3 (RGB) channels: of a stack of frames give "
        "the newest alone (--frames-stacked stacks them), of RGBA leave alpha out"
    )


def _brightness(picture: npt.NDArray[Any]) -> Picture:
    """Floats 0..1 as levels 0..255."""
    if not np.issubdtype(picture.dtype, np.floating):
        raise PictureError(f"{described(picture)} where uint8 or floats in 0..1 are expected")
    least, most = float(picture.min()), float(picture.max())
    if not (least >= 0.0 and most <= 1.0):  # so that NaN is refused too
        raise PictureError(
            f"{described(picture)} with values in {least:g}..{most:g}, where floats are expected in 0..1"
        )
    return np.rint(picture * 255.0).astype(np.uint8)


def described(array: npt.NDArray[Any]) -> str:
    """Dtype and shape, like `uint8[84, 84, 3]`."""
    return f"{array.dtype}{list(array.shape)}"


def why_blind(frames: Sequence[Frame]) -> str | None:
    """What keeps a policy from seeing anything in these frames of several moments; None: nothing does."""
    least, most = (int(extreme(frames)) for extreme in (np.min, np.max))
    if most - least < LEAST_CONTRAST:
        return f"all pixels of all its pictures are in {least}..{most} of 0..255"
    if all(is_flat(frame) for frame in frames):
        return "each of its pictures has one colour only"
    if len(frames) > 1 and all(np.array_equal(frame, frames[0]) for frame in frames[1:]):
        return f"all its {len(frames)} pictures are alike, whatever the actions"
    return None
