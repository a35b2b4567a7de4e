"""Markers in real pictures: with noise, another light, a lens and compression between the scene and its colours.

Nothing has exactly its colour there. A coloured disc is what differs from gray in its colour's direction, which no
offset changes and a gain only scales; how much it differs is calibrated in an episode's first frame. Discs in gray
scenes are told apart by their order: the hand is brighter than the target, and that than the arm, in any light.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from bpn_shared.spec.rewards import Frames
from bpn_tasks.circle_fit import fitted_disc
from bpn_tasks.markers import REACHING_TARGET_RADIUS_PX, Disc

Image = npt.NDArray[np.float32]

_FAINTEST = 0.35
"""Of a colour's difference from gray, what is left of it in the worst light that is taken for the marker's."""
_DIMMEST = 0.6
"""Of the difference in the first frame, what is left of it in a frame that is exposed for a shorter time."""
_FEWEST_PX = 3
_SURE = 0.3
_HAND_RADIUS_PX = 4.0
_HAND_CONTRAST = 60.0
"""Levels between the hand and the background, at least."""
_TARGET_SHARE = 0.5
"""Of that contrast, the target's at least: it is 0.63 in the scene, the arm's 0.31."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where a marker was seen.

    Attributes:
        x_px, y_px: its centre.
        confidence: 0..1: of a coloured disc, which part of its edge lies on a circle; of a gray one, its area's
            share of the expected one, or the other way round.
    """

    x_px: float
    y_px: float
    confidence: float


class ColouredDisc:
    """Finds a coloured disc in the frames of one episode.

    Args:
        disc: what it looks like in the scene.
        first: uint8[3, h, w], an episode's first frame.

    Attributes:
        level: its colour's difference from gray in that frame, of the scene's; 0 where it is not to be seen.
    """

    def __init__(self, disc: Disc, first: npt.NDArray[np.uint8]) -> None:
        self._disc = disc
        found = float(_smooth(likeness(first, disc.rgb)).max())
        self.level = found if found >= _FAINTEST else 0.0

    def see(self, frame: npt.NDArray[np.uint8]) -> Sighting | None:
        """The largest blob of its colour, as a circle; None where there is none."""
        if not self.level:
            return None
        like = likeness(frame, self._disc.rgb)
        level = max(float(_smooth(like).max()), _DIMMEST * self.level)
        blob = _largest((like > level / 2).astype(np.uint8))
        if blob is None:
            return None
        x_px, y_px, on_circle = fitted_disc(blob, self._disc.radius_px)
        return Sighting(x_px, y_px, on_circle) if on_circle >= _SURE else None


def likeness(frame: npt.NDArray[np.uint8], rgb: tuple[int, int, int]) -> Image:
    """How much of a colour's difference from gray every pixel has: 1 where it is that colour, 0 where it is gray.

    Args:
        frame: uint8[3, h, w]; single wrong pixels are overruled by their neighbours.

    Returns:
        float32[h, w].
    """
    colour = np.array(rgb, np.float32)
    direction = colour - colour.mean()
    seen = cv2.medianBlur(np.ascontiguousarray(frame.transpose(1, 2, 0)), 3).astype(np.float32)
    alike: Image = seen @ (direction / (direction @ direction))
    return _blurred(alike)


def exactness(frame: npt.NDArray[np.uint8], disc: Disc) -> float:
    """Which share of the disc, as it is seen in a frame, has exactly its colour; 1 where no disc is seen."""
    blob = _largest((likeness(frame, disc.rgb) > 1 / 2).astype(np.uint8))
    exact = (frame == np.array(disc.rgb, np.uint8)[:, None, None]).all(axis=0)
    return 1.0 if blob is None else float(exact.sum() / blob.sum())


def hand_and_target(frames: Frames) -> tuple[list[Sighting | None], Sighting | None]:
    """The hand in every frame of the reaching task, and the target in the first one.

    Args:
        frames: uint8[n, 1, 84, 84], n >= 1.
    """
    hands: list[Sighting | None] = []
    target: Sighting | None = None
    ratio = 1.0
    for index, frame in enumerate(frames):
        image = cv2.medianBlur(np.ascontiguousarray(frame[0]), 3).astype(np.float32)
        background = float(np.median(image))
        where, level = _brightest(image, _HAND_RADIUS_PX)
        contrast = level - background
        if contrast < _HAND_CONTRAST:
            hands.append(None)
            continue
        if index == 0:
            _erased = _without(image, where, 2 * _HAND_RADIUS_PX, background)
            there, second = _brightest(_erased, REACHING_TARGET_RADIUS_PX - 1)
            ratio = (second - background) / contrast
            if ratio >= _TARGET_SHARE:
                edge = background + (second - background) / 2
                target = _measured(_erased, there, REACHING_TARGET_RADIUS_PX, edge)
        edge = background + contrast * (1 + min(max(ratio, _TARGET_SHARE), 0.9)) / 2
        hands.append(_measured(image, where, _HAND_RADIUS_PX, edge))
    return hands, target


def _blurred(image: Image) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (3, 3), 0), np.float32)


def _smooth(image: Image) -> Image:
    return np.asarray(cv2.blur(image, (5, 5)), np.float32)


def _largest(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8] | None:
    """Of the connected pixels that are 1, the most; None where they are too few to be anything."""
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count < 2:
        return None
    label = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    if statistics[label, cv2.CC_STAT_AREA] < _FEWEST_PX:
        return None
    blob: npt.NDArray[np.uint8] = (labels == label).astype(np.uint8)
    return blob


def _within(
    shape: tuple[int, ...], where: tuple[int, int], radius_px: float
) -> npt.NDArray[np.bool_]:
    y, x = np.ogrid[: shape[0], : shape[1]]
    inside: npt.NDArray[np.bool_] = (x - where[0]) ** 2 + (y - where[1]) ** 2 <= radius_px**2
    return inside


def _brightest(image: Image, radius_px: float) -> tuple[tuple[int, int], float]:
    """The pixel (x, y) around which a disc of that radius is brightest on average, and how bright it is."""
    size = 2 * int(radius_px) + 1
    kernel = _within((size, size), (size // 2, size // 2), radius_px - 0.5).astype(np.float32)
    means = cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    _, level, _, where = cv2.minMaxLoc(means)
    return (int(where[0]), int(where[1])), float(level)


def _without(image: Image, where: tuple[int, int], radius_px: float, level: float) -> Image:
    erased = image.copy()
    erased[_within(image.shape, where, radius_px)] = level
    return erased


def _measured(image: Image, where: tuple[int, int], radius_px: float, edge: float) -> Sighting:
    """The centroid of what is brighter than the edge around a pixel."""
    bright = _blurred(image) > edge
    near = (bright & _within(image.shape, where, radius_px + 2)).astype(np.uint8)
    moments = cv2.moments(near, binaryImage=True)
    area, expected = moments["m00"], np.pi * radius_px**2
    if area == 0:
        return Sighting(float(where[0]), float(where[1]), 0.0)
    confidence = min(area, expected) / max(area, expected)
    return Sighting(moments["m10"] / area, moments["m01"] / area, confidence)
