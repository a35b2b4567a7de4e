"""The sliding window and the target on its arc."""

from itertools import pairwise
from math import hypot

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_robot_sim.tracking import geometry
from bpn_robot_sim.tracking.robot import TrackingRobot
from bpn_shared.spec.markers import TRACKING_TARGET
from bpn_shared.spec.tasks import TASKS

TASK = TASKS["tracking"]
MOVES_PX = [-8, -4, -2, 0, 2, 4, 8]  # section V-A-2, with the first 2 as -2
actions_lists = st.lists(st.integers(0, 6), max_size=40)
seeds = st.integers(0, 2**63 - 1)


def step(robot: TrackingRobot, action: int) -> None:
    robot.command(action)
    robot.settle()


@given(seed=seeds, actions=actions_lists)
def test_the_window_moves_by_whole_pixels_and_stays_in_the_world(
    tracking_robot: TrackingRobot, seed: int, actions: list[int]
) -> None:
    tracking_robot.reset(seed)
    goal_px, y_px = tracking_robot.info()["window_world_px"]
    for action in actions:
        step(tracking_robot, action)
        goal_px = min(max(goal_px + MOVES_PX[action], 42), 138)
        assert tracking_robot.commanded_px == pytest.approx(goal_px)
        assert tracking_robot.info()["window_world_px"] == pytest.approx((goal_px, 60), abs=0.05)
    assert y_px == 60


@given(seed=seeds)
def test_an_episode_starts_with_the_whole_target_in_the_frame(
    tracking_robot: TrackingRobot, seed: int
) -> None:
    frame = tracking_robot.reset(seed)
    x, y = tracking_robot.info()["target_px"]
    assert 11.5 <= x <= 71.5
    assert 11.5 <= y <= 71.5
    shown = np.count_nonzero((frame == np.array(TRACKING_TARGET.rgb)[:, None, None]).all(axis=0))
    assert shown == pytest.approx(np.pi * TRACKING_TARGET.radius_px**2, rel=0.05)


def test_starts_are_spread_over_arc_and_window(tracking_robot: TrackingRobot) -> None:
    truths = []
    for seed in range(400):
        tracking_robot.reset(seed)
        truths.append(tracking_robot.info())
    targets = np.array([truth["target_world_px"][0] for truth in truths])
    windows = np.array([truth["window_world_px"][0] for truth in truths])
    # x = 90 + 60 sin(uniform): half of all targets are within 60 sin(45 degrees) of the middle.
    assert np.mean(np.abs(targets - 90) < 60 * np.sqrt(0.5)) == pytest.approx(0.5, abs=0.1)
    assert windows.min() < 45
    assert windows.max() > 135
    assert np.std(targets - windows) > 10


@given(seed=seeds)
def test_the_target_is_on_the_upper_half_circle_and_moves_at_constant_speed(
    tracking_robot: TrackingRobot, seed: int
) -> None:
    tracking_robot.reset(seed)
    path = [tracking_robot.info()["target_world_px"]]
    for _ in range(40):
        step(tracking_robot, TASK.hold_action)
        path.append(tracking_robot.info()["target_world_px"])
    for x, y in path:
        assert hypot(x - 90, y - 90) == pytest.approx(60)
        assert y <= 90
    chord_px = 2 * 60 * np.sin(np.radians(3))  # 6 degrees a step
    moves = [hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(path)]
    turns = [move for move in moves if move != pytest.approx(chord_px)]
    assert len(turns) <= 2  # at the half circle's ends, 180 degrees apart
    assert max(moves) <= chord_px + 1e-9


@given(phase_deg=st.floats(0, 360), window_px=st.floats(42, 138))
def test_no_place_of_the_window_sees_forty_steps(phase_deg: float, window_px: float) -> None:
    xs = [geometry.target_world_px(phase_deg + 6 * t)[0] for t in range(41)]
    assert max(abs(x - window_px) for x in xs) > 41.5


def test_hold_keeps_the_window_and_the_target_moves_on(tracking_robot: TrackingRobot) -> None:
    tracking_robot.reset(5)
    before = tracking_robot.info()
    step(tracking_robot, TASK.hold_action)
    after = tracking_robot.info()
    assert after["window_world_px"] == pytest.approx(before["window_world_px"])
    assert after["target_world_px"] != before["target_world_px"]


def test_a_step_is_a_control_period_of_realtime_play(tracking_robot: TrackingRobot) -> None:
    def play(periods: list[list[float]]) -> list[bytes]:
        frames = [tracking_robot.reset(3).tobytes()]
        for action, period in enumerate(periods):
            tracking_robot.command(action)
            for seconds in period:
                tracking_robot.advance(seconds)
            frames.append(tracking_robot.frame().tobytes())
        return frames

    assert play([[0.1, 0.045]] * 7) == play([[TASK.control_period_s]] * 7)


@given(seed=seeds)
def test_greedy_play_keeps_within_a_window_step_of_the_best(
    tracking_robot: TrackingRobot, seed: int
) -> None:
    tracking_robot.reset(seed)
    offsets = []
    for _ in range(40):
        step(tracking_robot, tracking_robot.greedy_action())
        offsets.append(abs(tracking_robot.info()["target_px"][0] - 41.5))
    # At the world's ends the window stays up to 12 px behind; from the start it is up to 30 px away.
    assert max(offsets[15:]) <= 12 + 0.05
