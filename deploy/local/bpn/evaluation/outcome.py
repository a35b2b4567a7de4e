"""What the trials of an evaluation came to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_learner.reward import rewards
from bpn_robot_sim.reaching.geometry import TARGET_RADIUS_PX
from bpn_shared.config import RunConfig
from bpn_shared.messages.episode import Episode


@dataclass(frozen=True, slots=True)
class Outcome:
    """One trial.

    Attributes:
        return_px: sum of rewards, from the pixels.
        steps: until its end.
        success: reaching: the hand ends on the target; other tasks: the target was kept for all T steps.
        deadline_misses: control periods without an action in time (realtime pacing).
    """

    return_px: float
    steps: int
    success: bool
    deadline_misses: int


def outcome(config: RunConfig, episode: Episode) -> Outcome:
    """The outcome of one trial."""
    rewards_px = rewards(config.task, episode.frames)
    success = not episode.meta.failed
    if config.task == "reaching":
        success = bool(rewards_px[-1] >= -TARGET_RADIUS_PX)
    return Outcome(
        float(rewards_px.sum()), episode.steps, success, int(episode.meta.deadline_misses)
    )


def summarize(config: RunConfig, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Mean and standard deviation over trials, and every trial.

    Returns:
        trials, return_px, px_per_step and length ({mean, std}), tracking_time (mean steps and seconds, and their
        percentage of T, as the paper's Table II), success_share, deadline_misses,
        returns_px, lengths, successes.

    Raises:
        ValueError: there are no outcomes.
    """
    if not outcomes:
        raise ValueError("no outcomes: nothing was played")
    steps = np.array([one.steps for one in outcomes])
    returns_px = np.array([one.return_px for one in outcomes])
    period_s = config.task_spec.control_period_s
    return {
        "trials": len(outcomes),
        "return_px": _mean_std(returns_px),
        "px_per_step": _mean_std(returns_px / steps),
        "length": _mean_std(steps),
        "tracking_time": {
            "steps": round(float(steps.mean()), 2),
            "seconds": round(float(steps.mean()) * period_s, 3),
            "percent": round(100 * float(steps.mean()) / config.steps, 1),
        },
        "success_share": round(float(np.mean([one.success for one in outcomes])), 4),
        "deadline_misses": sum(one.deadline_misses for one in outcomes),
        "returns_px": [round(float(value), 3) for value in returns_px],
        "lengths": steps.tolist(),
        "successes": [one.success for one in outcomes],
    }


def _mean_std(values: npt.NDArray[Any]) -> dict[str, float]:
    return {"mean": round(float(values.mean()), 3), "std": round(float(values.std()), 3)}
