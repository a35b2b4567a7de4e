from math import hypot

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.spec.framing import in_frame, nearest_on_border, reward_px

anywhere = st.floats(-200, 300)
inside = st.floats(0, 83)


@given(inside, inside)
def test_in_the_frame_the_reward_is_minus_the_distance_from_the_middle(x: float, y: float) -> None:
    assert in_frame(x, y)
    assert reward_px(x, y) == pytest.approx(-hypot(x - 41.5, y - 41.5))


@given(anywhere, anywhere)
def test_outside_the_nearest_point_of_the_frame_counts(x: float, y: float) -> None:
    near_x, near_y = sorted((0, x, 83))[1], sorted((0, y, 83))[1]
    assert in_frame(x, y) == ((near_x, near_y) == (x, y))
    assert reward_px(x, y) == pytest.approx(reward_px(near_x, near_y))
    assert -41.5 * 2**0.5 - 1e-9 <= reward_px(x, y) <= 0


@given(inside, inside)
def test_the_nearest_border_is_at_the_smallest_of_four_distances(x: float, y: float) -> None:
    border = nearest_on_border(x, y)
    assert 0 in border or 83 in border
    assert hypot(border[0] - x, border[1] - y) == pytest.approx(min(x, y, 83 - x, 83 - y))
