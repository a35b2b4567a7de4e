"""The dynamic programming optimum against brute force and against the simulation."""

import cmath
from collections.abc import Iterator
from itertools import product
from math import radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_robot_sim.reaching import geometry, optimum
from bpn_robot_sim.reaching.robot import ReachingRobot
from bpn_shared.spec.tasks import TASKS

TOLERANCE_PX = 0.5  # twenty steps of a servo that stops up to 0.05 degrees away


@pytest.fixture(scope="module")
def robot() -> Iterator[ReachingRobot]:
    robot = ReachingRobot()
    yield robot
    robot.close()


def simulated_return(robot: ReachingRobot, actions: list[int]) -> float:
    robot.reset(seed=0)
    total = 0.0
    for action in actions:
        robot.command(action)
        robot.settle()
        total += robot.reward()
    return total


def ideal_return(actions: tuple[int, ...]) -> float:
    """The return of ideal servos, by complex numbers from the task's description."""

    def hand(q1: float, q2: float) -> complex:
        return 20 * cmath.rect(1, radians(q1)) + 18 * cmath.rect(1, radians(q1 + q2))

    q1, q2 = geometry.START_DEG
    total = 0.0
    for action in actions:
        turn = (-90, -45, -30, 0, 30, 45, 90)[action % 7]
        q1, q2 = (q1 + turn, q2) if action < 7 else (q1, q2 + turn)
        total -= abs(hand(q1, q2) - hand(*geometry.TARGET_POSE_DEG))
    return total


@pytest.mark.parametrize("steps", [0, 1, 2, 3])
def test_optimum_is_the_best_of_all_sequences(steps: int) -> None:
    best = max(ideal_return(actions) for actions in product(range(14), repeat=steps))
    assert optimum.optimal_return(steps) == pytest.approx(best)


@pytest.mark.parametrize("steps", [0, 1, 2, 3])
def test_random_play_returns_the_mean_of_all_sequences(steps: int) -> None:
    returns = [ideal_return(actions) for actions in product(range(14), repeat=steps)]
    assert optimum.random_return(steps) == pytest.approx(sum(returns) / len(returns))


@pytest.mark.parametrize("steps", [1, 5, 20, 40])
def test_optimal_actions_give_the_optimal_return_in_the_simulation(
    robot: ReachingRobot, steps: int
) -> None:
    actions = optimum.optimal_actions(steps)
    assert len(actions) == steps
    assert ideal_return(tuple(actions)) == pytest.approx(optimum.optimal_return(steps))
    assert simulated_return(robot, actions) == pytest.approx(
        optimum.optimal_return(steps), abs=TOLERANCE_PX
    )


@given(actions=st.lists(st.integers(0, TASKS["reaching"].actions - 1), min_size=20, max_size=20))
def test_nothing_beats_the_optimum(robot: ReachingRobot, actions: list[int]) -> None:
    assert simulated_return(robot, actions) <= optimum.optimal_return(20) + TOLERANCE_PX


@given(
    prefix=st.integers(0, 20),
    actions=st.lists(st.integers(0, TASKS["reaching"].actions - 1), min_size=20, max_size=20),
)
def test_nothing_close_to_the_optimal_play_beats_it(
    robot: ReachingRobot, prefix: int, actions: list[int]
) -> None:
    changed = [*optimum.optimal_actions(20)[:prefix], *actions[prefix:]]
    assert simulated_return(robot, changed) <= optimum.optimal_return(20) + TOLERANCE_PX


def test_the_task_is_neither_trivial_nor_long(robot: ReachingRobot) -> None:
    actions = optimum.optimal_actions(20)
    assert -120 < optimum.optimal_return(20) < -80
    assert len([action for action in actions if action not in (3, 10)]) == 4
    simulated_return(robot, actions)
    assert robot.reward() == pytest.approx(0, abs=0.1)


def test_negative_horizon_is_refused() -> None:
    with pytest.raises(ValueError, match="steps = -1"):
        optimum.optimal_return(-1)


def test_the_command_prints_the_optimum(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["optimum", "--steps", "3"])
    optimum.main()
    assert f"{optimum.optimal_return(3):.2f} px" in capsys.readouterr().out
