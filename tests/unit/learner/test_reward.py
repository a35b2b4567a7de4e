"""Rewards from pixels, against geometry that numpy draws."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.reward import RewardError, reaching_rewards, rewards
from bpn_shared.markers import ARM_LEVEL, BACKGROUND_LEVEL, HAND_LEVEL, TARGET_LEVEL

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
    with pytest.raises(RewardError, match="the reaching task has uint8"):
        reaching_rewards(frames)


def test_a_task_without_a_reward_is_named() -> None:
    with pytest.raises(RewardError, match="'flying' has no reward"):
        rewards("flying", np.stack([draw((20, 20), (60, 60))] * 2))
