"""Disturbed pictures: the same for the same seed, and what each disturbance does."""

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_shared.camera.disturbed import EpisodeCamera, blurred
from bpn_shared.camera.jpeg import compressed
from bpn_shared.spec.disturbances import parse

Picture = npt.NDArray[np.uint8]
seeds = st.integers(0, 2**64 - 1)
ALL = "noise=25,offset=-30..30,gain=0.7..1.3,white_balance=0.2,blur=1,jpeg=30..90,exposure=0.2,salt_pepper=0.02"


def scene(channels: int = 3, size: int = 84) -> Picture:
    y, x = np.mgrid[:size, :size]
    picture = np.zeros((channels, size, size), np.uint8)
    picture[0, (y - 40) ** 2 + (x - 30) ** 2 < 200] = 255
    picture[-1, (y - 20) ** 2 + (x - 60) ** 2 < 150] = 160
    picture[channels // 2] |= (x * 2).astype(np.uint8) // 2
    return picture


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(0, 999), st.sampled_from([1, 3]))
def test_a_seed_and_a_step_decide_a_picture(seed: int, step: int, channels: int) -> None:
    frame = scene(channels)
    before = frame.copy()
    seen = EpisodeCamera(parse(ALL), seed).picture(frame, step)
    assert (seen.dtype, seen.shape) == (np.uint8, frame.shape)
    assert np.array_equal(seen, EpisodeCamera(parse(ALL), seed).picture(frame, step))
    assert not np.array_equal(seen, EpisodeCamera(parse(ALL), seed).picture(frame, step + 1))
    assert np.array_equal(frame, before)


@given(seeds)
def test_nothing_that_is_off_changes_a_picture(seed: int) -> None:
    frame = scene()
    assert EpisodeCamera({}, seed).picture(frame, 3) is frame
    assert EpisodeCamera(parse("latency=9,backlash=2"), seed).picture(frame, 3) is frame
    neutral = "noise=0,offset=0,gain=1,white_balance=0,blur=0,exposure=0,salt_pepper=0"
    assert np.array_equal(EpisodeCamera(parse(neutral), seed).picture(frame, 3), frame)


@given(seeds)
def test_one_kind_beside_another_changes_nothing_that_it_draws(seed: int) -> None:
    alone = EpisodeCamera(parse("offset=-30..30"), seed).levels
    beside = EpisodeCamera(parse("noise=0..9,offset=-30..30,gain=0.5..2"), seed).levels
    assert alone["offset"] == beside["offset"]
    assert -30 <= alone["offset"] <= 30


def seen(levels: str, frame: Picture, seed: int = 1) -> npt.NDArray[np.int64]:
    return EpisodeCamera(parse(levels), seed).picture(frame, 0).astype(np.int64)


def test_what_each_kind_does() -> None:
    gray = np.full((3, 84, 84), 100, np.uint8)
    assert seen("noise=20", gray).std() == pytest.approx(20, abs=0.5)
    assert (seen("offset=-30", gray) == 70).all()
    assert (seen("gain=1.3", gray) == 130).all()
    assert (seen("gain=3", gray) == 255).all()
    balanced = seen("white_balance=0.2", gray).mean(axis=(1, 2))
    assert len(set(balanced)) == 3
    assert (abs(balanced - 100) <= 20.5).all()
    assert (seen("white_balance=0.2", gray[:1]) == 100).all()
    exposed = [EpisodeCamera(parse("exposure=0.2"), 1).picture(gray, t).mean() for t in range(50)]
    assert 80 <= min(exposed) < 85
    assert 115 < max(exposed) <= 120
    salted = seen("salt_pepper=0.1", gray)
    assert (salted == 255).mean() == pytest.approx(0.05, abs=0.01)
    assert (salted == 0).mean() == pytest.approx(0.05, abs=0.01)
    assert (salted[0] == salted[1]).all()


@given(st.floats(0.3, 3))
def test_a_blur_is_opencvs(sigma_px: float) -> None:
    plane = scene(1)[0].astype(np.float32)
    size = 2 * max(1, round(3 * sigma_px)) + 1
    expected = cv2.GaussianBlur(plane, (size, size), sigma_px, borderType=cv2.BORDER_REPLICATE)
    np.testing.assert_allclose(blurred(plane[None], sigma_px)[0], expected, atol=0.01)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 100), st.sampled_from([1, 3]), st.sampled_from([84, 64, 47]))
def test_jpeg_is_the_codecs_but_for_rounding(quality: int, channels: int, size: int) -> None:
    picture = scene(channels, size)
    image = picture.transpose(1, 2, 0)[:, :, ::-1] if channels == 3 else picture[0]
    done, data = cv2.imencode(
        ".jpg", np.ascontiguousarray(image), [cv2.IMWRITE_JPEG_QUALITY, quality]
    )
    assert done
    decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    expected = decoded[:, :, ::-1].transpose(2, 0, 1) if channels == 3 else decoded[None]
    assert np.abs(compressed(picture, quality).astype(int) - expected).mean() < 1.5
