"""A target in the camera's frame: when it is lost, and how far from the middle it is.

The rule of the tasks that keep a target in the frame (the paper, sections V-A-2 and VI-B): the robot ends
the episode when the target's centre leaves the frame, and the reward is minus its distance from the middle.
A centre outside counts as the nearest point of the frame's border: where a target that is mostly or wholly
outside went, its pixels hardly tell, but where it crossed the border they do.

Pixel coordinates are OpenCV's: x to the right, y down, the centre of the first pixel is (0, 0).
"""

from math import dist, hypot

from bpn_shared.spec.network import IMAGE_SIZE_PX

BORDER_PX = IMAGE_SIZE_PX - 1
"""The frame reaches from 0 to here, the centres of its outermost pixels, in x and y."""
MIDDLE_PX = BORDER_PX / 2


def in_frame(x_px: float, y_px: float) -> bool:
    """Whether a target with this centre is in the frame."""
    return 0 <= x_px <= BORDER_PX and 0 <= y_px <= BORDER_PX


def reward_px(x_px: float, y_px: float) -> float:
    """Minus the distance of this centre from the frame's middle, -58.7 at a corner and beyond."""
    return -hypot(_clipped(x_px) - MIDDLE_PX, _clipped(y_px) - MIDDLE_PX)


def nearest_on_border(x_px: float, y_px: float) -> tuple[float, float]:
    """The point of the frame's border that is nearest to a centre in the frame."""
    corners = (0.0, float(BORDER_PX))
    candidates = [*((x, y_px) for x in corners), *((x_px, y) for y in corners)]
    return min(candidates, key=lambda point: dist(point, (x_px, y_px)))


def _clipped(coordinate_px: float) -> float:
    return min(max(coordinate_px, 0.0), float(BORDER_PX))
