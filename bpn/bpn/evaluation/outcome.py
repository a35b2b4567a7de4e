"""What the trials of an evaluation came to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_learner.reward import episode_rewards
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.statistics import mean_std
from bpn_shared.runs.success import share, success_of
from bpn_shared.spec.config import RunConfig


@dataclass(frozen=True, slots=True)
class Outcome:
    """One trial.

    Attributes:
        total: the return, sum of rewards: in pixels, or as the environment of a gym: task counts.
        steps: until its end.
        terminated: the task ended it, good or bad, before its time.
        success: as the task or its environment defines it; None where neither does.
        deadline_misses: control periods without an action in time (realtime pacing).
    """

    total: float
    steps: int
    terminated: bool
    success: bool | None
    deadline_misses: int


def outcome(config: RunConfig, episode: Episode) -> Outcome:
    """The outcome of one trial."""
    rewards = episode_rewards(config.task_spec, episode)
    meta = episode.meta
    return Outcome(
        total=float(rewards.sum()),
        steps=episode.steps,
        terminated=meta.terminated,
        success=success_of(config.task_spec, meta, rewards),
        deadline_misses=int(meta.deadline_misses),
    )


def distinct_trials(episodes: Sequence[Episode]) -> int:
    """How many of the trials differ in what was seen or done: greedy play from one start is always the same."""
    return len({(one.frames.tobytes(), one.actions.tobytes()) for one in episodes})


def summarize(
    config: RunConfig, outcomes: Sequence[Outcome], *, distinct: int | None = None
) -> dict[str, Any]:
    """Mean and standard deviation (n - 1; None of one) over trials, and every trial.

    Args:
        distinct: how many of them differ (all); where all are alike, nothing is known of a spread.

    Returns:
        trials, distinct_trials, return_px, px_per_step and length ({mean, std}), tracking_time (mean steps and
        seconds, and their percentage of T, as the paper's Table II), terminated (how many the task ended),
        success_share and successes (None where neither task nor environment defines it), deadline_misses,
        returns_px, lengths. Of a gym: task, whose rewards have units of their own and whose steps
        have no duration: return, return_per_step and returns, and no tracking_time.

    Raises:
        ValueError: there are no outcomes.
    """
    if not outcomes:
        raise ValueError("no outcomes: nothing was played")
    steps = np.array([one.steps for one in outcomes])
    returns = np.array([one.total for one in outcomes])
    in_pixels = config.task_spec.rewards == "pixels"
    unit = "_px" if in_pixels else ""
    mean_steps = float(steps.mean())
    succeeded = share(one.success for one in outcomes)
    tracking_time = {
        "steps": round(mean_steps, 2),
        "seconds": round(mean_steps * config.task_spec.control_period_s, 3),
        "percent": round(100 * mean_steps / config.steps, 1),
    }
    return {
        "trials": len(outcomes),
        "distinct_trials": len(outcomes) if distinct is None else distinct,
        f"return{unit}": _mean_std(returns, distinct),
        "px_per_step" if in_pixels else "return_per_step": _mean_std(returns / steps, distinct),
        "length": _mean_std(steps, distinct),
        **({"tracking_time": tracking_time} if in_pixels else {}),
        "terminated": sum(one.terminated for one in outcomes),
        "success_share": None if succeeded is None else round(succeeded, 4),
        "deadline_misses": sum(one.deadline_misses for one in outcomes),
        f"returns{unit}": [round(float(value), 3) for value in returns],
        "lengths": steps.tolist(),
        "successes": [one.success for one in outcomes],
    }


def _mean_std(values: npt.NDArray[Any], distinct: int | None) -> dict[str, float | None]:
    mean, std = mean_std(values[:1] if distinct == 1 else values)
    return {"mean": round(mean, 3), "std": None if std is None else round(std, 3)}
