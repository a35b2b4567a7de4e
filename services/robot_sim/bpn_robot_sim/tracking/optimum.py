"""The best return of play that never loses the target: exact finite-horizon dynamic programming.

From one start the window can only be at few places: even distances from where it began or from the world's
ends. With an ideal servo V_k(place) = max_a [r + V_{k-1}(next place)] over the actions that keep the target
is exact. Play that loses it early has a better return still, for it stops paying; that is not
what the task asks. `python -m bpn_robot_sim.tracking.optimum` prints the mean over starts.
"""

import argparse
from functools import cache

import numpy as np

from bpn_robot_sim import EPISODE_STEPS
from bpn_robot_sim.tracking import geometry
from bpn_shared.spec.framing import in_frame, reward_px

_STEPS = EPISODE_STEPS["tracking"]
_NEVER = float("-inf")


def optimal_return(phase_deg: float, window_px: float, steps: int = _STEPS) -> float:
    """The largest sum of rewards (px, not discounted) from a start, of play that keeps the target.

    Args:
        phase_deg: of the target at the start.
        window_px: the window's centre in x at the start.
        steps: T.

    Returns:
        Minus infinity if no play keeps the target that long.
    """

    @cache
    def value(step: int, place_px: float) -> float:
        if step == steps:
            return 0.0
        target_px = geometry.target_world_px(phase_deg + geometry.DEG_PER_STEP * (step + 1))
        best = _NEVER
        for move_px in geometry.ACTIONS_PX:
            after_px = geometry.clipped_to_world(place_px + move_px)
            seen_px = geometry.to_image(target_px, after_px)
            if in_frame(*seen_px):
                best = max(best, reward_px(*seen_px) + value(step + 1, after_px))
        return best

    return value(0, window_px)


def mean_optimal_return(seeds: range, steps: int = _STEPS) -> float:
    """The mean over the starts that the simulation draws for these seeds."""
    starts = [geometry.start(seed) for seed in seeds]
    return float(np.mean([optimal_return(phase, window, steps) for phase, window in starts]))


def main() -> None:
    """Prints the mean optimal return."""
    parser = argparse.ArgumentParser(description="The best return of tracking without a loss.")
    parser.add_argument("--starts", type=int, default=200, help="default: %(default)s")
    starts = parser.parse_args().starts
    print(f"mean over {starts} starts: {mean_optimal_return(range(starts)):.1f} px")


if __name__ == "__main__":
    main()
