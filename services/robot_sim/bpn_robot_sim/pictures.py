"""What counts as a picture, and pictures as frames: nothing that looks like one is taken on trust."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict
from PIL import Image

from bpn_robot.frame import Frame, is_flat
from bpn_robot.robot import RobotFault
from bpn_shared.spec.gym import Crop
from bpn_shared.spec.network import IMAGE_SIZE_PX

Picture = npt.NDArray[np.uint8]

SYMBOLS = (
    "they may be symbols, such as kinds of things, and no levels of brightness; a wrapper that draws them "
    "(env_wrappers), or frames_from = 'renders', shows pictures"
)
"""What to do about observations that only look like pictures."""
LEAST_CONTRAST = 16
"""Levels of 255 between the darkest and the brightest of all pixels of a probe; less is taken for black."""
_GRAY_RGB = (1, 3)
_RGBA = 4
_STACKED = (
    "of a stack of frames give the newest alone (frames_stacked stacks them), or choose "
    "frames_from = 'renders'"
)


class PictureError(ValueError):
    """What was seen is no picture; the message says what it is."""


def as_frame(picture: Picture, channels: int, size_px: int = IMAGE_SIZE_PX) -> Frame:
    """A picture uint8[height, width] or [height, width, 1, 3 or 4] as uint8[channels, size_px, size_px].

    Each pixel is the mean of the area that it covers, so that motion below a pixel is still seen.
    """
    image = Image.fromarray(picture.squeeze(-1) if picture.shape[2:] == (1,) else picture)
    image = image.convert("L" if channels == 1 else "RGB")
    small = np.asarray(image.resize((size_px, size_px), Image.Resampling.BOX))
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


def cropped(picture: Picture, crop: Crop | None) -> Picture:
    """A part of the picture; None: all of it.

    Raises:
        RobotFault: the picture does not reach so far.
    """
    if crop is None:
        return picture
    height, width = picture.shape[:2]
    if crop.x + crop.width > width or crop.y + crop.height > height:
        raise RobotFault(
            f"crop = {','.join(map(str, crop))} reaches beyond its pictures, which are {width} x {height}"
        )
    return picture[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]


def brightest(pictures: Sequence[Picture]) -> Picture:
    """The brightest of each pixel in pictures of one shape.

    Raises:
        RobotFault: they have several.
    """
    shapes = {picture.shape for picture in pictures}
    if len(shapes) > 1:
        raise RobotFault(f"its pictures have several sizes ({shapes}); leave max_over_frames out")
    most: Picture = np.max(pictures, axis=0)
    return most


class ObservedPictures:
    """Observations of a space whose every value is a picture, or has one under a key.

    Args:
        space: Box of two or three axes; channels, 1 or 3, come last or first; or 4 last, RGBA. Or a Dict of it.
        key: of the picture in a Dict.

    Raises:
        PictureError: the space's values are no pictures, or it cannot be told which they are.
    """

    def __init__(self, space: Any, key: str = "") -> None:
        self._key = key
        space = _part_of(space, key)
        if not isinstance(space, Box) or len(space.shape) not in (2, 3):
            raise PictureError(f"its observations are no images ({space})")
        self._low, self._high = float(np.min(space.low)), float(np.max(space.high))
        shares = np.issubdtype(space.dtype, np.floating) and (self._low, self._high) == (0.0, 1.0)
        if not (shares or (space.dtype == np.uint8 and self._low < self._high)):
            raise PictureError(
                f"its observations ({space}) are neither uint8 nor floats in 0..1, so their values are "
                "no levels of brightness"
            )
        if not shares and (self._low, self._high) not in ((0.0, 1.0), (0.0, 255.0)):
            raise PictureError(
                f"its observations ({space}) do not use the levels 0..255: {SYMBOLS}"
            )
        self._shape, self._dtype = space.shape, space.dtype
        self._channels_first = _channels_first(space)

    def picture(self, observation: Any) -> Picture:
        """One observation, as uint8[height, width] or [height, width, 1 or 3].

        Values of 0 and 1 alone become 0 and 255.

        Raises:
            PictureError: it is not of its space, or its fourth channel is no alpha of 1 everywhere.
        """
        if self._key:
            if not isinstance(observation, Mapping) or self._key not in observation:
                raise PictureError(f"an observation without {self._key!r}, which its space has")
            observation = observation[self._key]
        array = np.asarray(observation)
        if array.shape != self._shape or array.dtype != self._dtype:
            expected = f"{self._dtype}{list(self._shape)}"
            raise PictureError(f"an observation {described(array)}, its space has {expected}")
        picture = array.transpose(1, 2, 0) if self._channels_first else array
        if picture.shape[2:] == (_RGBA,):
            if not (picture[:, :, 3] == self._high).all():
                raise PictureError(f"4 channels, of which the last is no alpha: {_STACKED}")
            picture = picture[:, :, :3]
        if self._dtype != np.uint8:
            return _brightness(picture)
        return picture if self._high > 1.0 else _brightness(picture.astype(np.float64))


def _channels_first(space: Box) -> bool:
    if len(space.shape) == 2 or space.shape[2] in (*_GRAY_RGB, _RGBA):
        return False
    if space.shape[0] in _GRAY_RGB:
        return True
    raise PictureError(
        f"its observations ({space}) have neither 1 (gray) nor 3 (RGB) channels: {_STACKED}"
    )


def _part_of(space: Any, key: str) -> Any:
    """What is under the key in a Dict; without a key, the space itself.

    Raises:
        PictureError: the key is missing, or there is no such part; the message lists what there is.
    """
    if not isinstance(space, Dict):
        if key:
            raise PictureError(f"observation_key = {key!r}: its observations are no Dict ({space})")
        return space
    parts = ", ".join(space.spaces)
    if not key:
        raise PictureError(
            f"its observations are a Dict of {parts}: the picture among them is named by observation_key"
        )
    if key not in space.spaces:
        raise PictureError(f"observation_key = {key!r}: its observations are a Dict of {parts}")
    return space.spaces[key]


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
    least, most = _extremes(frames)
    if most - least < LEAST_CONTRAST:
        return f"all pixels of all its pictures are in {least}..{most} of 0..255"
    if all(is_flat(frame) for frame in frames):
        return "each of its pictures has one colour only"
    if len(frames) > 1 and all(np.array_equal(frame, frames[0]) for frame in frames[1:]):
        return f"all its {len(frames)} pictures are alike, whatever the actions"
    return None


def is_dark(frames: Sequence[Frame]) -> bool:
    """Whether small numbers are all there is, as where symbols are taken for levels of brightness."""
    return 0 < _extremes(frames)[1] < LEAST_CONTRAST


def _extremes(frames: Sequence[Frame]) -> tuple[int, int]:
    return int(np.min(frames)), int(np.max(frames))
