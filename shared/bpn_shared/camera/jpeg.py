"""What JPEG compression leaves of a picture (ITU T.81): without a codec, so that it is the same wherever numpy is.

Eight by eight pixels are transformed and rounded to multiples of the standard's tables, scaled by the quality as
the Independent JPEG Group's library does; colours at half the resolution. The rest of the format loses nothing.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

BLOCK_PX = 8
# fmt: off
_LUMINANCE = np.array([
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56,
    14, 17, 22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92,
    49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
]).reshape(BLOCK_PX, BLOCK_PX)
_CHROMINANCE = np.full((BLOCK_PX, BLOCK_PX), 99)
_CHROMINANCE[:4, :4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]]
# fmt: on
_TO_YCC = np.array(
    [
        [0.299, 0.587, 0.114],
        [-0.168736, -0.331264, 0.5],
        [0.5, -0.418688, -0.081312],
    ]
)
_TO_RGB = np.linalg.inv(_TO_YCC)
_FREQUENCY, _PLACE = np.mgrid[:BLOCK_PX, :BLOCK_PX]
_COSINES = np.cos((2 * _PLACE + 1) * _FREQUENCY * np.pi / (2 * BLOCK_PX)) * 0.5
_COSINES[0] *= np.sqrt(0.5)
"""The orthonormal cosine transform: row f is the wave of frequency f."""


def compressed(picture: npt.NDArray[np.uint8], quality: int) -> npt.NDArray[np.uint8]:
    """The picture after compression and decompression.

    Args:
        picture: uint8[c, h, w]; three channels are RGB, others are compressed each by itself as gray.
        quality: 1..100.

    Returns:
        uint8[c, h, w].
    """
    luminance, chrominance = tables(quality)
    planes = picture.astype(np.float64) - 128
    if len(planes) != 3:
        planes = np.stack([_plane(plane, luminance) for plane in planes])
    else:
        y, *colours = np.tensordot(_TO_YCC, planes + 128, 1)
        halves = [_doubled(_plane(_halved(c), chrominance), y.shape) for c in colours]
        planes = (
            np.tensordot(_TO_RGB, np.stack([_plane(y - 128, luminance) + 128, *halves]), 1) - 128
        )
    return np.clip(np.rint(planes + 128), 0, 255).astype(np.uint8)


@lru_cache(maxsize=100)
def tables(quality: int) -> tuple[Floats, Floats]:
    """The steps to which luminance and chrominance are rounded, float64[8, 8] each."""
    percent = 5000 // quality if quality < 50 else 200 - 2 * quality
    scaled = [
        np.clip((table * percent + 50) // 100, 1, 255) for table in (_LUMINANCE, _CHROMINANCE)
    ]
    return scaled[0].astype(np.float64), scaled[1].astype(np.float64)


def _plane(plane: Floats, steps: Floats) -> Floats:
    height, width = plane.shape
    padded = np.pad(plane, ((0, -height % BLOCK_PX), (0, -width % BLOCK_PX)), "edge")
    rows, columns = padded.shape[0] // BLOCK_PX, padded.shape[1] // BLOCK_PX
    blocks = padded.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
    waves = np.rint(_COSINES @ blocks @ _COSINES.T / steps) * steps
    restored = np.clip(_COSINES.T @ waves @ _COSINES, -128, 127)
    whole: Floats = restored.swapaxes(1, 2).reshape(padded.shape)
    return whole[:height, :width]


def _halved(plane: Floats) -> Floats:
    """The means of two by two pixels; an odd last row or column is repeated."""
    height, width = plane.shape
    padded = np.pad(plane, ((0, height % 2), (0, width % 2)), "edge")
    means: Floats = padded.reshape((height + 1) // 2, 2, (width + 1) // 2, 2).mean(axis=(1, 3))
    return means


def _doubled(plane: Floats, shape: tuple[int, ...]) -> Floats:
    """Twice as many rows and columns, each three parts of the nearer and one of the next one, cut to the shape."""
    for axis in (0, 1):
        line = np.moveaxis(plane, axis, 0)
        beyond = np.concatenate([line[:1], line, line[-1:]])
        pair = np.stack([3 * line + beyond[:-2], 3 * line + beyond[2:]], axis=1) / 4
        plane = np.moveaxis(pair.reshape(2 * len(line), -1), 0, axis)
    return plane[: shape[0], : shape[1]]
