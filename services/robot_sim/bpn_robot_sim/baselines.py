"""What to measure a policy against where the target moves: play that knows the truth, and random play.

`python -m bpn_robot_sim.baselines tracking` prints their returns. Greedy looks one step ahead, which costs a
little where the window or a unit is at its limit; `tracking.optimum` looks to the end.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, cast, get_args

import numpy as np

from bpn_robot.robot import Robot
from bpn_robot_sim import EPISODE_STEPS
from bpn_robot_sim.robots import make_robot

Policy = Literal["greedy", "random", "hold"]
MOVING_TARGETS = ("tracking", "pan_tilt", "pan_tilt_both")


class Follower(Robot, Protocol):
    """A robot whose target moves, and who knows best."""

    def greedy_action(self) -> int:
        """The action that brings the frame closest to where the target will be, from the truth."""


@dataclass(frozen=True, slots=True)
class Played:
    """One episode: its return in pixels, its length in steps and whether the target was lost."""

    return_px: float
    steps: int
    lost: bool


def play(robot: Follower, policy: Policy, seed: int, steps: int) -> Played:
    """One episode in lockstep; the seed draws the start and the random actions."""
    random = np.random.default_rng([seed, 1])
    choose: dict[Policy, Callable[[], int]] = {
        "greedy": robot.greedy_action,
        "random": lambda: int(random.integers(robot.task.joint_actions)),
        "hold": lambda: robot.task.hold_action,
    }
    robot.reset(seed)
    return_px, step = 0.0, 0
    while step < steps and not robot.terminated:
        robot.command(choose[policy]())
        robot.settle()
        return_px += robot.reward()
        step += 1
    return Played(return_px, step, robot.terminated)


def main() -> None:
    """Prints mean return, length and share of lost targets of each policy."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("task", choices=MOVING_TARGETS)
    parser.add_argument("--episodes", type=int, default=200, help="default: %(default)s")
    options = parser.parse_args()
    robot = cast(Follower, make_robot(options.task))
    print(
        f"{options.task}, {options.episodes} episodes    return (px)    steps   lost  px per step"
    )
    for policy in get_args(Policy):
        episodes = [
            play(robot, policy, seed, EPISODE_STEPS[options.task])
            for seed in range(options.episodes)
        ]
        returns_px = np.array([episode.return_px for episode in episodes])
        steps = np.array([episode.steps for episode in episodes])
        print(
            f"{policy:>24} {returns_px.mean():8.1f} ± {returns_px.std(ddof=1):5.1f} {steps.mean():7.1f}"
            f" {np.mean([episode.lost for episode in episodes]):6.0%}"
            f" {returns_px.sum() / steps.sum():10.1f}"
        )
    robot.close()


if __name__ == "__main__":
    main()
