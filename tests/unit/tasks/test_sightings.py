"""Markers in disturbed pictures, against discs that numpy draws."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_shared.camera.disturbed import EpisodeCamera
from bpn_shared.spec.disturbances import parse
from bpn_shared.spec.rewards import RewardError
from bpn_tasks.circle_fit import fitted_disc
from bpn_tasks.markers import (
    ARM_LEVEL,
    HAND_LEVEL,
    PAN_TILT_MARKER,
    TARGET_LEVEL,
    TRACKING_TARGET,
    Disc,
)
from bpn_tasks.rewards import framing_rewards, reaching_rewards
from bpn_tasks.sightings import ColouredDisc

Picture = npt.NDArray[np.uint8]
WORST = "noise=0..25,offset=-30..30,gain=0.7..1.3,salt_pepper=0..0.02,blur=0..1,white_balance=0.1"
coordinates = st.floats(14, 69)
seeds = st.integers(0, 2**64 - 1)
y, x = np.mgrid[:84, :84]


def coloured(centre: tuple[float, float] | None, disc: Disc) -> Picture:
    """A picture uint8[3, 84, 84] of a disc before muted shapes."""
    picture = np.zeros((3, 84, 84), np.uint8)
    picture[:] = np.array([90, 100, 80], np.uint8)[:, None, None]
    picture[:, 10:30, 40:70] = np.array([150, 140, 120], np.uint8)[:, None, None]
    if centre is not None:
        inside = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 <= disc.radius_px**2
        picture[:, inside] = np.array(disc.rgb, np.uint8)[:, None]
    return picture


def arm(hand: tuple[int, int]) -> Picture:
    """The reaching task's kind of picture uint8[1, 84, 84]; its target is at (60, 15)."""
    picture = np.zeros((84, 84), np.uint8)
    picture[(x - 60) ** 2 + (y - 15) ** 2 <= 25] = TARGET_LEVEL
    picture[40:45, 20:60] = ARM_LEVEL
    picture[(x - hand[0]) ** 2 + (y - hand[1]) ** 2 <= 16] = HAND_LEVEL
    return picture[None]


def disturbed(levels: str, seed: int, frames: list[Picture]) -> Picture:
    camera = EpisodeCamera(parse(levels), seed)
    return np.stack([camera.picture(frame, step) for step, frame in enumerate(frames)])


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=4), seeds)
@pytest.mark.parametrize("disc", [TRACKING_TARGET, PAN_TILT_MARKER])
def test_a_disc_is_where_it_is_whatever_the_camera(
    disc: Disc, centres: list[tuple[float, float]], seed: int
) -> None:
    frames = disturbed(WORST, seed, [coloured(centre, disc) for centre in centres])
    truth = [-np.hypot(cx - 41.5, cy - 41.5) for cx, cy in centres[1:]]
    assert framing_rewards(frames, disc, exact=False) == pytest.approx(truth, abs=1.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(6, 77), st.integers(30, 77)), min_size=2, max_size=4), seeds)
def test_the_hand_is_where_it_is_whatever_the_camera(
    hands: list[tuple[int, int]], seed: int
) -> None:
    frames = disturbed(WORST, seed, [arm(hand) for hand in hands])
    truth = [-np.hypot(hx - 60, hy - 15) for hx, hy in hands[1:]]
    assert reaching_rewards(frames, exact=False) == pytest.approx(truth, abs=1.5)


@pytest.mark.parametrize("levels", ["gain=0.99", "offset=1", "jpeg=30", "noise=25"])
def test_one_count_of_a_colour_no_longer_ends_a_run(levels: str) -> None:
    tracked = disturbed(levels, 1, [coloured((30, 30), TRACKING_TARGET)] * 2)
    assert framing_rewards(tracked, TRACKING_TARGET) == pytest.approx([-16.3], abs=0.5)
    reached = disturbed(levels, 1, [arm((30, 60))] * 2)
    assert reaching_rewards(reached) == pytest.approx([-54.1], abs=0.7)


def test_pictures_without_the_marker_show_none() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (2, 3, 84, 84), np.uint8)
    for frames in (noise, np.stack([coloured(None, TRACKING_TARGET)] * 2)):
        with pytest.raises(RewardError, match="frame 0 shows no target"):
            framing_rewards(frames, TRACKING_TARGET, exact=False)
    with pytest.raises(RewardError, match="frame 0 shows no target"):
        reaching_rewards(np.zeros((2, 1, 84, 84), np.uint8), exact=False)


def test_a_target_that_is_gone_counts_where_it_left() -> None:
    frames = [coloured((12, 30), TRACKING_TARGET), coloured(None, TRACKING_TARGET)]
    rewards = framing_rewards(disturbed("noise=10", 3, frames), TRACKING_TARGET)
    assert rewards == pytest.approx([-np.hypot(41.5, 11.5)], abs=0.5)


def test_what_sticks_out_of_a_disc_does_not_move_it() -> None:
    mask = ((x - 40) ** 2 + (y - 50) ** 2 <= 144).astype(np.uint8)
    mask[46:50, 52:64] = 1
    found_x, found_y, on_circle = fitted_disc(mask, 12.0)
    assert (found_x, found_y) == pytest.approx((40, 50), abs=0.5)
    assert 0.6 < on_circle < 1
    whole = fitted_disc(((x - 40) ** 2 + (y - 50) ** 2 <= 144).astype(np.uint8), 12.0)
    assert whole[2] == 1


def test_the_largest_of_several_blobs_counts_and_the_faintest_light_is_calibrated() -> None:
    picture = coloured((30, 30), TRACKING_TARGET)
    picture[:, 70:74, 70:74] = np.array(TRACKING_TARGET.rgb, np.uint8)[:, None, None]
    dark = (picture * 0.5).astype(np.uint8)
    sees = ColouredDisc(TRACKING_TARGET, dark)
    assert sees.level == pytest.approx(0.5, abs=0.02)
    found = sees.see(dark)
    assert found is not None
    assert (found.x_px, found.y_px) == pytest.approx((30, 30), abs=0.3)
