"""Where markers are in an episode's frames: exactly where a simulator drew them, or as a real camera has them."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from bpn_shared.spec.network import IMAGE_SIZE_PX
from bpn_shared.spec.rewards import Frames, RewardError
from bpn_tasks.circle_fit import disc_centre_px
from bpn_tasks.framing import nearest_on_border
from bpn_tasks.markers import HAND_LEVEL, TARGET_LEVEL, Disc
from bpn_tasks.sightings import ColouredDisc, Sighting, exactness, hand_and_target

Positions = npt.NDArray[np.float64]
Point = tuple[float, float]

_EXACT = 0.5
"""Of a marker's pixels in the first frame: with fewer in exactly its colour, the pictures are a real camera's."""
_ABOUT = 12
"""Levels by which noise changes many pixels."""


def reaching_path_px(frames: Frames, *, exact: bool = True) -> tuple[Positions, Positions]:
    """Where the target is and where the hand is in every frame, from the pixels.

    Args:
        frames: uint8[T+1, 1, 84, 84].
        exact: whether both have exactly their levels, as a simulator draws them; if less than half of what is
            about as bright in the first frame has, or this is False, they are found as `sightings` does.

    Returns:
        float64[2] and float64[T+1, 2], (x, y) in pixels.

    Raises:
        RewardError: the frames have another shape, or a marker is missing.
    """
    _check(frames, channels=1)
    if not exact or not all(_drawn_flat(frames[0], level) for level in (TARGET_LEVEL, HAND_LEVEL)):
        hands, target = hand_and_target(frames)
        if target is None:
            raise _unseen(0, "target", f"pixel of gray level {TARGET_LEVEL}")
        for index, hand in enumerate(hands):
            if hand is None:
                raise _unseen(index, "hand", f"pixel of gray level {HAND_LEVEL}")
        return np.array(_at(target), np.float64), np.array(
            [_at(hand) for hand in hands if hand], np.float64
        )
    target_px = _centroids_px(frames[:1, 0], TARGET_LEVEL, "target")[0]
    return target_px, _centroids_px(frames[:, 0], HAND_LEVEL, "hand")


def target_path_px(frames: Frames, target: Disc, *, exact: bool = True) -> Positions:
    """Where the target's centre is in every frame, from the pixels.

    Where the border cuts the target, its centre is that of the disc fitted to what is left. A centre
    outside, in the last frame of a lost target, counts as the nearest point of the border. A target of
    which nothing is left counts as the point of the border nearest to where it was seen last.

    Args:
        frames: uint8[T+1, 3, 84, 84].
        target: what the target looks like.
        exact: whether it has exactly its colour, as a simulator draws it; if less than half of it has in the first
            frame, or this is False, it is found as `sightings` does.

    Returns:
        float64[T+1, 2], (x, y) in pixels.

    Raises:
        RewardError: the frames have another shape, or the first one shows no target.
    """
    _check(frames, channels=3)
    see = _exactly(target)
    if not exact or exactness(frames[0], target) < _EXACT:
        see = ColouredDisc(target, frames[0]).see
    seen_px: Point | None = None
    path_px: list[Point] = []
    for frame in frames:
        sighting = see(frame)
        if sighting is not None:
            seen_px = _at(sighting)
        elif seen_px is None:
            raise _unseen(0, "target", f"pixel of colour {target.rgb}")
        else:
            seen_px = nearest_on_border(*seen_px)
        path_px.append(seen_px)
    return np.array(path_px, np.float64)


def _drawn_flat(frame: Frames, level: int) -> bool:
    """Whether what has about that level in a frame has exactly that level."""
    about = np.abs(frame.astype(np.int16) - level) <= _ABOUT
    return bool(2 * (frame == level).sum() >= max(1, about.sum()))


def _exactly(target: Disc) -> Callable[[npt.NDArray[np.uint8]], Sighting | None]:
    """Finds a disc that has exactly its colour."""
    colour = np.array(target.rgb, np.uint8)[:, None, None]

    def see(frame: npt.NDArray[np.uint8]) -> Sighting | None:
        mask = (frame == colour).all(axis=0).astype(np.uint8)
        centre_px = disc_centre_px(mask, target.radius_px)
        return None if centre_px is None else Sighting(*centre_px, confidence=1.0)

    return see


def _at(sighting: Sighting) -> Point:
    return sighting.x_px, sighting.y_px


def _unseen(frame: int, name: str, what: str) -> RewardError:
    return RewardError(
        f"frame {frame} shows no {name} (no {what}, nor anything like it): is the robot's scene this task's, and "
        "all of it in view?"
    )


def _centroids_px(images: Frames, level: int, name: str) -> Positions:
    """Of the pixels with exactly this gray level in each image uint8[n, 84, 84]: float64[n, 2], (x, y).

    Markers are a few pixels of thousands, so it pays to look for them once in all images.
    """
    index, pixel = np.divmod(np.flatnonzero(images == level), images[0].size)
    y_px, x_px = np.divmod(pixel, images.shape[-1])
    count = np.bincount(index, minlength=len(images))
    if not count.all():
        raise _unseen(int(np.argmin(count)), name, f"pixel of gray level {level}")
    sums_px = [np.bincount(index, of_px, len(images)) for of_px in (x_px, y_px)]
    return np.stack(sums_px, axis=1) / count[:, None]


def _check(frames: Frames, channels: int) -> None:
    expected = (channels, IMAGE_SIZE_PX, IMAGE_SIZE_PX)
    if frames.dtype != np.uint8 or frames.shape[1:] != expected or len(frames) == 0:
        raise RewardError(
            f"frames are {frames.dtype}{list(frames.shape)}, the task has uint8[T+1, "
            f"{', '.join(map(str, expected))}]"
        )
