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
    edge_y, edge_x = np.nonzero(mask - cv2.erode(mask, _CROSS))  # the image's border is no edge
    edge = np.stack([edge_x, edge_y], axis=1).astype(np.float64)
    x_px, y_px = _fitted(edge, centroid + outward * radius_px / 2, radius_px - _EDGE_INSET_PX)
    return x_px, y_px


def _cut_towards(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """In x and y: -1 or 1 for the border of the image that the pixels touch, 0 for none."""
    left, right = bool(mask[:, 0].any()), bool(mask[:, -1].any())
    top, bottom = bool(mask[0].any()), bool(mask[-1].any())
    return np.array([right - left, bottom - top], np.float64)


def _fitted(
    edge: npt.NDArray[np.float64], centre: npt.NDArray[np.float64], expected_radius_px: float
) -> list[float]:
    """The circle's centre by least squares; edge float64[n, 2], centre float64[2] to begin with."""
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
    return [float(value) for value in centre]
