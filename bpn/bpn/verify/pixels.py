"""Rewards from pixels, in numpy: minus a distance in pixels between what the frames show (docs/tasks).

They are computed here a second time for the paper's tasks, where pictures are exact. Others, a real camera's too,
are computed by the plug-in that the learner has them from, which shows that it used what that computes.
"""

import numpy as np
import numpy.typing as npt

from bpn_shared.spec.disturbances import of_scope
from bpn_shared.spec.rewards import RewardError, reward_function
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.markers import HAND_LEVEL, PAN_TILT_MARKER, TARGET_LEVEL, TRACKING_TARGET, Disc

Frames = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Point = npt.NDArray[np.float64]

_LAST_PX = 83.0
_MIDDLE_PX = _LAST_PX / 2
_REACHING = "reaching"
_ABOUT_LEVEL, _ABOUT_COLOUR = 12, 60
_DISCS = {"tracking": TRACKING_TARGET, "pan_tilt": PAN_TILT_MARKER}


class PixelError(ValueError):
    """A frame does not show what the reward is computed from."""


def rewards_of(task: TaskSpec, frames: Frames) -> npt.NDArray[np.float64]:
    """r_1..r_T of an episode of the task; `frames` as of `rewards_px`.

    Raises:
        PixelError: a marker is missing.
        PluginError: what computes them is not installed here.
    """
    if task.rewards is not None and _are_exact(task, frames[0]):
        return rewards_px(task.rewards, frames)
    function = reward_function(task)
    if function is None:
        raise ValueError(f"task {task.name!r} has no rewards from pixels")
    try:
        return function(frames, task)
    except RewardError as error:
        raise PixelError(str(error)) from error


def _are_exact(task: TaskSpec, first: Frames) -> bool:
    if of_scope(task.disturbances, "picture"):
        return False
    if task.rewards == _REACHING:
        return all(
            _drawn_flat(first, (level,), _ABOUT_LEVEL) for level in (TARGET_LEVEL, HAND_LEVEL)
        )
    return task.rewards in _DISCS and _drawn_flat(first, _DISCS[task.rewards].rgb, _ABOUT_COLOUR)


def _drawn_flat(frame: Frames, colour: tuple[int, ...], about: int) -> bool:
    """Whether at least half of what has about a colour in uint8[c, h, w] has exactly that colour."""
    apart = np.abs(frame.astype(np.int16) - np.array(colour, np.int16)[:, None, None]).max(axis=0)
    return bool(2 * (apart == 0).sum() >= max(1, (apart <= about).sum()))


def rewards_px(name: str, frames: Frames) -> npt.NDArray[np.float64]:
    """r_1..r_T of an episode's frames uint8[T+1, c, 84, 84]; the reward of step t is what frame t+1 shows.

    Raises:
        PixelError: a marker is missing.
    """
    if name == _REACHING:
        target = _centroid(frames[0, 0] == TARGET_LEVEL, 0)
        hands = [_centroid(frame[0] == HAND_LEVEL, t) for t, frame in enumerate(frames)]
        offsets = np.array(hands[1:]) - target
    else:
        offsets = np.clip(_path(frames, _DISCS[name])[1:], 0, _LAST_PX) - _MIDDLE_PX
    return -np.hypot(offsets[:, 0], offsets[:, 1])


def _centroid(mask: Mask, frame: int) -> Point:
    """(x, y) of the pixels in a mask [h, w]."""
    rows, columns = np.nonzero(mask)
    if len(rows) == 0:
        raise PixelError(f"frame {frame} shows no marker")
    return np.array([columns.mean(), rows.mean()])


def _path(frames: Frames, disc: Disc) -> Point:
    """Where the disc's centre is in every frame, [T+1, 2]; of an invisible one the border's nearest point."""
    path: list[Point] = []
    for t, frame in enumerate(frames):
        mask = (frame == np.array(disc.rgb, np.uint8)[:, None, None]).all(axis=0)
        if mask.any():
            path.append(_disc_centre(mask, disc.radius_px, t))
        elif path:
            path.append(_border_near(path[-1]))
        else:
            raise PixelError("frame 0 shows no target")
    return np.array(path)


def _border_near(point: Point) -> Point:
    x, y = point
    candidates = [(0.0, y), (_LAST_PX, y), (x, 0.0), (x, _LAST_PX)]
    return np.array(min(candidates, key=lambda candidate: np.hypot(*(candidate - point))))


def _disc_centre(mask: Mask, radius_px: float, frame: int) -> Point:
    """The centroid of a whole disc; one that the border cuts is fitted to its edge pixels.

    Least squares of their distances to a circle, with the expected radius as one more term (Gauss-Newton).
    """
    centre = _centroid(mask, frame)
    left, right, top, bottom = (side.any() for side in (mask[:, 0], mask[:, -1], mask[0], mask[-1]))
    outward = np.array([float(right) - float(left), float(bottom) - float(top)])
    if not outward.any():
        return centre
    rows, columns = np.nonzero(_edge(mask))
    edge = np.column_stack([columns, rows]).astype(float)
    # pixel centres of a disc's edge lie 0.4 px inside it on average
    expected = radius = radius_px - 0.4
    centre = centre + outward * radius_px / 2
    for _ in range(30):
        towards = centre - edge
        distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
        rows_of = np.column_stack([towards / distance[:, None], -np.ones(len(edge))])
        normal = rows_of.T @ rows_of + np.diag([1e-3, 1e-3, 1e-3 + 1.0])
        slope = rows_of.T @ (distance - radius) + np.array([0, 0, radius - expected])
        step = -np.linalg.solve(normal, slope)
        centre, radius = centre + step[:2], radius + step[2]
        if np.abs(step).max() < 1e-3:
            break
    return centre


def _edge(mask: Mask) -> Mask:
    """Pixels with a neighbour outside the mask; the image's border is no edge."""
    padded = np.pad(mask, 1, constant_values=True)
    inner = mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return mask & ~inner
