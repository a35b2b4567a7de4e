"""Where the centre of a disc is, from those of its pixels that the image's border leaves."""

import cv2
import numpy as np
import numpy.typing as npt

_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_RADIUS_WEIGHT = 1.0
"""Of the expected radius among the edge's pixels: enough to hold it where only a short arc is left."""
_DAMPING = 1e-3
_MAX_STEPS = 30
_CONVERGED_PX = 1e-3
_MAX_FITS = 5
_OFF_CIRCLE_PX = 1.5
_EDGE_INSET_PX = 0.4
"""The centres of a disc's outermost pixels are this much nearer to its centre than its edge, on average."""


def disc_centre_px(mask: npt.NDArray[np.uint8], radius_px: float) -> tuple[float, float] | None:
    """The centre (x, y) of the disc whose visible pixels are 1 in the mask; None where none is.

    A whole disc's centre is its pixels' centroid. One that the border cuts is fitted: the sum of the squared
    distances of its edge pixels to a circle is minimized by Gauss-Newton over centre and radius. On discs of
    radius 9 to 12 px with the centre in the image that is mostly within 0.3 px, and within 1 px where a
    corner leaves a quarter. A centre outside is an extrapolation, but its nearest point in the image is
    found as well as a centre inside.

    Args:
        mask: uint8[h, w] of 0 and 1.
        radius_px: the expected radius; the true one may differ by a fifth.
    """
    moments = cv2.moments(mask, binaryImage=True)
    if moments["m00"] == 0:
        return None
    centroid = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    outward = _cut_towards(mask)
    if not outward.any():
        return float(centroid[0]), float(centroid[1])
    guess = centroid + outward * radius_px / 2
    centre, _ = _fitted(_edge(mask), guess, radius_px - _EDGE_INSET_PX)
    return float(centre[0]), float(centre[1])


def fitted_disc(mask: npt.NDArray[np.uint8], radius_px: float) -> tuple[float, float, float]:
    """The centre (x, y) of the disc in a mask whose edge is not to be trusted everywhere, and how round it is.

    As `disc_centre_px`, but edge pixels that lie off the circle are left out and it is fitted again. Whole discs
    are fitted too: what sticks out of one would move its centroid.

    Args:
        mask: uint8[h, w] of 0 and 1, not all 0.
        radius_px: the expected radius.

    Returns:
        x, y, and the share 0..1 of the edge that is on the circle.
    """
    edge = _edge(mask)
    if len(edge) == 0:  # it fills the image
        return (mask.shape[1] - 1) / 2, (mask.shape[0] - 1) / 2, 0.0
    moments = cv2.moments(mask, binaryImage=True)
    centroid = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    guess = centroid + _cut_towards(mask) * radius_px / 2
    on_circle = np.ones(len(edge), np.bool_)
    for _ in range(_MAX_FITS):
        guess, radius = _fitted(edge[on_circle], guess, radius_px - _EDGE_INSET_PX)
        misses_px = np.abs(np.linalg.norm(edge - guess, axis=1) - radius)
        # at first the worst would move the circle itself: the better half decides what is far from it
        far_px = max(_OFF_CIRCLE_PX, 2 * float(np.median(misses_px)))
        before, on_circle = on_circle, misses_px <= far_px
        if (on_circle == before).all():
            break
    share = float((misses_px <= _OFF_CIRCLE_PX).mean())
    return float(guess[0]), float(guess[1]), share


def _edge(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """The outermost pixels (x, y), float64[n, 2]; the image's border is no edge."""
    edge_y, edge_x = np.nonzero(mask - cv2.erode(mask, _CROSS))
    return np.stack([edge_x, edge_y], axis=1).astype(np.float64)


def _cut_towards(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """In x and y: -1 or 1 for the border of the image that the pixels touch, 0 for none."""
    left, right = bool(mask[:, 0].any()), bool(mask[:, -1].any())
    top, bottom = bool(mask[0].any()), bool(mask[-1].any())
    return np.array([right - left, bottom - top], np.float64)


def _fitted(
    edge: npt.NDArray[np.float64], centre: npt.NDArray[np.float64], expected_radius_px: float
) -> tuple[npt.NDArray[np.float64], float]:
    """The circle's centre and radius by least squares; edge float64[n, 2], centre float64[2] to begin with."""
    radius = expected_radius_px
    for _ in range(_MAX_STEPS):
        offsets = centre - edge
        distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-9)
        jacobian = np.column_stack([offsets / distances[:, None], -np.ones(len(edge))])
        normal = jacobian.T @ jacobian + _DAMPING * np.eye(3)
        gradient = jacobian.T @ (distances - radius)
        normal[2, 2] += _RADIUS_WEIGHT
        gradient[2] += _RADIUS_WEIGHT * (radius - expected_radius_px)
        step = -np.linalg.solve(normal, gradient)
        centre, radius = centre + step[:2], radius + step[2]
        if np.abs(step).max() < _CONVERGED_PX:
            break
    return centre, float(radius)
