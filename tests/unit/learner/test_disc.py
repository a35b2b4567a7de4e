"""Centres of discs that the image's border cuts, against discs that numpy draws."""

from math import hypot

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bpn_learner.disc import disc_centre_px

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


@given(x=st.floats(-9, 0), y=st.floats(-9, 12), radius=radii, flip=st.tuples(*[st.booleans()] * 3))
def test_a_disc_that_left_at_a_corner(
    x: float, y: float, radius: float, flip: tuple[bool, bool, bool]
) -> None:
    centre = np.array([83 - x if flip[0] else x, 83 - y if flip[1] else y])
    if flip[2]:
        centre = centre[::-1]
    mask = disc(centre[0], centre[1], radius)
    assume(mask.any())
    found = np.clip(np.array(disc_centre_px(mask, RADIUS_PX)), 0, 83)
    assert np.linalg.norm(found - np.clip(centre, 0, 83)) < 2.5


def test_nothing_visible_has_no_centre() -> None:
    assert disc_centre_px(np.zeros((84, 84), np.uint8), RADIUS_PX) is None


@given(x=st.integers(0, 83), y=st.integers(0, 83))
def test_a_single_pixel_is_no_error(x: int, y: int) -> None:
    mask = np.zeros((84, 84), np.uint8)
    mask[y, x] = 1
    found = disc_centre_px(mask, RADIUS_PX)
    assert found is not None
    assert np.isfinite(found).all()
