"""The best that any policy can do at reaching: exact finite-horizon dynamic programming.

Every rotation is a multiple of 15 degrees, so an arm with ideal servos has 24 x 24 poses, and
V_k(pose) = max_a [r(next pose) + V_{k-1}(next pose)] is exact. `python -m bpn_robot_sim.reaching.optimum`
prints what it finds.
"""

import argparse
from collections.abc import Callable
from math import dist

import numpy as np
import numpy.typing as npt

from bpn_robot_sim import EPISODE_STEPS
from bpn_robot_sim.reaching import geometry

_TURN = 360 // geometry.GRID_DEG
_STEPS = EPISODE_STEPS["reaching"]


def optimal_return(steps: int = _STEPS) -> float:
    """The largest sum of rewards (px, not discounted) over that many steps from the start pose.

    Raises:
        ValueError: steps is negative.
    """
    return float(_values(steps)[steps][_start()])


def random_return(steps: int = _STEPS) -> float:
    """The expected return of uniformly random actions, exact as the optimum is.

    Raises:
        ValueError: steps is negative.
    """
    return float(_values(steps, over_actions=np.mean)[steps][_start()])


def optimal_actions(steps: int = _STEPS) -> list[int]:
    """Actions that give `optimal_return(steps)`; of equally good ones the smallest.

    Raises:
        ValueError: steps is negative.
    """
    values, rewards = _values(steps), _rewards()
    pose, actions = _start(), []
    for remaining in range(steps, 0, -1):
        nexts = [_moved(pose, turns) for turns in geometry.ACTIONS_DEG]
        gains = [rewards[after] + values[remaining - 1][after] for after in nexts]
        best = int(np.argmax(gains))
        actions.append(best)
        pose = nexts[best]
    return actions


def _cell(joint_deg: tuple[int, int]) -> tuple[int, int]:
    return joint_deg[0] // geometry.GRID_DEG % _TURN, joint_deg[1] // geometry.GRID_DEG % _TURN


def _start() -> tuple[int, int]:
    return _cell(geometry.START_DEG)


def _moved(pose: tuple[int, int], turns_deg: tuple[int, int]) -> tuple[int, int]:
    turn1, turn2 = _cell(turns_deg)
    return (pose[0] + turn1) % _TURN, (pose[1] + turn2) % _TURN


def _rewards() -> npt.NDArray[np.float64]:
    """Reward (px) of being in each pose, [24, 24]."""
    angles = range(0, 360, geometry.GRID_DEG)
    return np.array(
        [[-dist(geometry.hand_px(q1, q2), geometry.TARGET_PX) for q2 in angles] for q1 in angles]
    )


def _values(
    steps: int, over_actions: Callable[..., npt.NDArray[np.float64]] = np.max
) -> npt.NDArray[np.float64]:
    """V_k of every pose with k steps to go, [steps + 1, 24, 24]."""
    if steps < 0:
        raise ValueError(f"steps = {steps} must not be negative")
    rewards = _rewards()
    values = np.zeros((steps + 1, _TURN, _TURN))
    for k in range(1, steps + 1):
        gain = rewards + values[k - 1]
        turns = [_cell(action) for action in geometry.ACTIONS_DEG]
        gains = [np.roll(gain, (-t1, -t2), axis=(0, 1)) for t1, t2 in turns]
        values[k] = over_actions(gains, axis=0)
    return values


def main() -> None:
    """Prints the optimal return and its actions."""
    parser = argparse.ArgumentParser(description="The optimal return of the reaching task.")
    parser.add_argument("--steps", type=int, default=_STEPS, help="T (default: %(default)s)")
    steps = parser.parse_args().steps
    print(f"optimal return over {steps} steps: {optimal_return(steps):.2f} px")
    print(f"actions: {optimal_actions(steps)}")
    print(f"expected return of random actions: {random_return(steps):.2f} px")


if __name__ == "__main__":
    main()
