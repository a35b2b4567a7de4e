"""The best return of tracking against brute force and against the simulation."""

from itertools import product
from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_robot_sim.baselines import play
from bpn_robot_sim.tracking import geometry, optimum
from bpn_robot_sim.tracking.robot import TrackingRobot

TOLERANCE_PX = 3.0  # forty steps of a servo that stops up to 0.05 px away


def ideal_return(phase_deg: float, window_px: float, actions: tuple[int, ...]) -> float | None:
    """The return with an ideal servo, from the task's description; None if the target is lost."""
    total = 0.0
    for step, action in enumerate(actions, start=1):
        window_px = min(max(window_px + (-8, -4, -2, 0, 2, 4, 8)[action], 42.0), 138.0)
        x_px, y_px = geometry.target_world_px(phase_deg + 6.0 * step)
        if not (-41.5 <= x_px - window_px <= 41.5 and -41.5 <= y_px - 60.0 <= 41.5):
            return None
        total -= hypot(x_px - window_px, y_px - 60.0)
    return total


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), steps=st.integers(0, 4))
def test_optimum_is_the_best_of_all_sequences_that_keep_the_target(seed: int, steps: int) -> None:
    start = geometry.start(seed)
    returns = [ideal_return(*start, actions) for actions in product(range(7), repeat=steps)]
    best = max(value for value in returns if value is not None)
    assert optimum.optimal_return(*start, steps) == pytest.approx(best)


def test_no_play_with_the_truth_beats_it_and_greedy_play_comes_close(
    tracking_robot: TrackingRobot,
) -> None:
    for seed in range(10):
        greedy = play(tracking_robot, "greedy", seed, 40)
        best = optimum.optimal_return(*geometry.start(seed))
        assert not greedy.lost
        assert best - 20 < greedy.return_px <= best + TOLERANCE_PX


def test_the_simulation_begins_at_the_start_of_the_seed(tracking_robot: TrackingRobot) -> None:
    tracking_robot.reset(7)
    phase_deg, window_px = geometry.start(7)
    info = tracking_robot.info()
    assert info["window_world_px"][0] == pytest.approx(window_px)
    assert info["target_world_px"] == pytest.approx(geometry.target_world_px(phase_deg))


def test_the_mean_is_over_the_seeds_starts() -> None:
    each = [optimum.optimal_return(*geometry.start(seed)) for seed in range(3)]
    assert optimum.mean_optimal_return(range(3)) == pytest.approx(sum(each) / 3)
