"""Rewards from pixels, against geometry that numpy draws."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.reward import RewardError, framing_rewards, reaching_rewards, rewards
from bpn_shared.spec.markers import (
    ARM_LEVEL,
    BACKGROUND_LEVEL,
    HAND_LEVEL,
    PAN_TILT_MARKER,
    TARGET_LEVEL,
    TRACKING_TARGET,
)

Point = tuple[int, int]
points = st.tuples(st.integers(5, 78), st.integers(5, 78))


def draw(target: Point | None, hand: Point | None) -> npt.NDArray[np.uint8]:
    """A frame uint8[1, 84, 84]: an arm, then discs of radius 4 px, the hand above the target."""
    y, x = np.mgrid[:84, :84]
    image = np.full((84, 84), BACKGROUND_LEVEL, np.uint8)
    image[:2, :] = ARM_LEVEL
    for center, level in ((target, TARGET_LEVEL), (hand, HAND_LEVEL)):
        if center is not None:
            image[(x - center[0]) ** 2 + (y - center[1]) ** 2 <= 16] = level
    return image[None]


def apart(a: Point, b: Point) -> bool:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 > 81


@given(points, points, st.lists(points, min_size=1, max_size=5))
def test_the_reward_is_minus_the_distance_to_the_first_frames_target(
    target: Point, start: Point, path: list[Point]
) -> None:
    if not apart(target, start):
        start = ((target[0] + 30 - 5) % 74 + 5, target[1])
    frames = np.stack([draw(target, hand) for hand in [start, *path]])
    expected = [-np.hypot(hand[0] - target[0], hand[1] - target[1]) for hand in path]
    assert rewards("reaching", frames) == pytest.approx(expected, abs=1e-9)


def test_the_target_may_be_hidden_later() -> None:
    frames = np.stack([draw((20, 20), (60, 60)), draw(None, (20, 30))])
    assert reaching_rewards(frames).tolist() == [-10.0]
    assert reaching_rewards(frames).dtype == np.float64


def test_a_missing_marker_is_named_with_its_frame() -> None:
    seen = draw((20, 20), (60, 60))
    with pytest.raises(RewardError, match="frame 2 shows no hand"):
        reaching_rewards(np.stack([seen, seen, draw((20, 20), None)]))
    with pytest.raises(RewardError, match="frame 0 shows no target"):
        reaching_rewards(np.stack([draw(None, (60, 60)), seen]))


@pytest.mark.parametrize(
    "frames",
    [np.zeros((2, 3, 84, 84), np.uint8), np.zeros((2, 84, 84), np.uint8), np.zeros((2, 1, 84, 84))],
)
def test_frames_of_another_kind_are_refused(frames: npt.NDArray[np.uint8]) -> None:
    with pytest.raises(RewardError, match=r"the task has uint8\[T\+1, 1, 84, 84\]"):
        reaching_rewards(frames)


def scene(target: tuple[float, float] | None, radius: float = 12) -> npt.NDArray[np.uint8]:
    """A frame uint8[3, 84, 84]: noise of every colour but the target's, then the target."""
    y, x = np.mgrid[:84, :84]
    image = np.random.default_rng(0).integers(0, 160, (3, 84, 84), np.uint8)
    if target is not None:
        inside = (x - target[0]) ** 2 + (y - target[1]) ** 2 <= radius**2
        image[:, inside] = np.array(TRACKING_TARGET.rgb, np.uint8)[:, None]
    return image


@given(st.lists(st.tuples(st.floats(0, 83), st.floats(0, 83)), min_size=1, max_size=5))
def test_the_reward_is_minus_the_distance_from_the_middle(path: list[tuple[float, float]]) -> None:
    frames = np.stack([scene((41.5, 41.5)), *map(scene, path)])
    expected = [-np.hypot(x - 41.5, y - 41.5) for x, y in path]
    assert rewards("tracking", frames) == pytest.approx(expected, abs=1.0)


def test_a_lost_target_counts_where_it_left() -> None:
    partly, gone = scene((-6, 30)), scene(None)
    measured = rewards("tracking", np.stack([scene((10, 30)), partly, gone]))
    assert measured == pytest.approx([-np.hypot(41.5, 11.5)] * 2, abs=0.3)
    jumped = rewards("tracking", np.stack([scene((70, 20)), gone]))
    assert jumped == pytest.approx([-np.hypot(41.5, 21.5)], abs=0.1)


def test_a_first_frame_without_target_is_an_error() -> None:
    with pytest.raises(RewardError, match="frame 0 shows no target"):
        framing_rewards(np.stack([scene(None), scene((40, 40))]), TRACKING_TARGET)


def test_each_task_looks_for_its_own_colour() -> None:
    frames = np.stack([scene((20, 20))] * 2)
    with pytest.raises(RewardError, match=r"\(0, 64, 255\)"):
        rewards("pan_tilt", frames)
    assert PAN_TILT_MARKER.rgb == (0, 64, 255)


@pytest.mark.parametrize("task", ["tracking", "pan_tilt"])
def test_gray_frames_are_refused_where_rgb_is_due(task: str) -> None:
    with pytest.raises(RewardError, match=r"the task has uint8\[T\+1, 3, 84, 84\]"):
        rewards(task, np.zeros((2, 1, 84, 84), np.uint8))


def test_a_task_without_a_reward_is_named() -> None:
    with pytest.raises(RewardError, match="'flying' has no reward"):
        rewards("flying", np.stack([draw((20, 20), (60, 60))] * 2))


def test_one_frame_has_no_reward_and_none_are_refused() -> None:
    first = draw((20, 20), (60, 60))
    assert reaching_rewards(np.stack([first])).shape == (0,)
    with pytest.raises(RewardError, match=r"frames are uint8\[0, 1, 84, 84\]"):
        reaching_rewards(np.stack([first])[:0])
