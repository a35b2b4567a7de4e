"""Centres of discs that the image's border cuts, against discs that numpy draws."""

from itertools import product
from math import hypot

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bpn_tasks.circle_fit import disc_centre_px

RADIUS_PX = 10.0
inside = st.floats(0, 83)
radii = st.floats(9, 11.5)


def disc(x: float, y: float, radius: float) -> npt.NDArray[np.uint8]:
    rows, columns = np.mgrid[:84, :84]
    return ((columns - x) ** 2 + (rows - y) ** 2 <= radius**2).astype(np.uint8)


@given(x=st.floats(12, 71), y=st.floats(12, 71), radius=radii)
def test_a_whole_disc(x: float, y: float, radius: float) -> None:
    assert disc_centre_px(disc(x, y, radius), RADIUS_PX) == pytest.approx((x, y), abs=0.3)


@given(x=inside, y=inside, radius=radii)
def test_any_disc_with_its_centre_in_the_image(x: float, y: float, radius: float) -> None:
    found = disc_centre_px(disc(x, y, radius), RADIUS_PX)
    assert found is not None
    assert hypot(found[0] - x, found[1] - y) < 1.5


@given(beyond=st.floats(0, 9), along=st.floats(12, 71), radius=radii, side=st.integers(0, 3))
def test_the_place_where_a_disc_crossed_a_side(
    beyond: float, along: float, radius: float, side: int
) -> None:
    x, y = [(-beyond, along), (83 + beyond, along), (along, -beyond), (along, 83 + beyond)][side]
    mask = disc(x, y, radius)
    assume(mask.any())
    found = np.clip(np.array(disc_centre_px(mask, RADIUS_PX)), 0, 83)
    assert found == pytest.approx(np.clip((x, y), 0, 83), abs=0.8)


def test_discs_that_left_at_a_corner() -> None:
    """A grid, for what is hard is rare: arcs so short that only the expected radius holds the fit."""
    worst_px = 0.0
    for x, y, radius in product(np.arange(-9, 0.5, 0.5), np.arange(-9, 12, 0.5), (9, 10.2, 11.5)):
        mask = disc(x, y, radius)
        if not mask.any():
            continue
        upright = np.array(disc_centre_px(mask, RADIUS_PX))
        across = np.array(disc_centre_px(np.ascontiguousarray(mask.T[:, ::-1]), RADIUS_PX))
        assert across == pytest.approx((83 - upright[1], upright[0]), abs=0.01)
        error_px = np.linalg.norm(np.clip(upright, 0, 83) - np.clip((x, y), 0, 83))
        worst_px = max(worst_px, float(error_px))
    assert worst_px < 2.0


def test_nothing_visible_has_no_centre() -> None:
    assert disc_centre_px(np.zeros((84, 84), np.uint8), RADIUS_PX) is None


@given(x=st.integers(0, 83), y=st.integers(0, 83))
def test_a_single_pixel_is_no_error(x: int, y: int) -> None:
    mask = np.zeros((84, 84), np.uint8)
    mask[y, x] = 1
    found = disc_centre_px(mask, RADIUS_PX)
    assert found is not None
    assert np.isfinite(found).all()
