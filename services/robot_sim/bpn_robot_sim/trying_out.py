"""Tries a Gymnasium environment out: a few random steps show what its declarations do not."""

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot.robot import RobotFault
from bpn_robot_sim.environment import GymEnvironment
from bpn_robot_sim.pictures import SYMBOLS, as_frame, is_dark, why_blind
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.joint_actions import count

Played = list[tuple[Frame, float]]


def play_at_random(env: GymEnvironment, task_name: str, channels: int, steps: int = 20) -> Played:
    """Random actions over as many episodes as it takes; looks at every picture and reward.

    Returns:
        The frames, each with the reward of the step before it.

    Raises:
        ConfigError: it raises, does not return what it should, or shows nothing; the message is one sentence.
    """
    random = np.random.default_rng(0)
    played: Played = []
    try:
        env.reset(0)
        played.append((as_frame(env.picture(), channels), 0.0))
        for step in range(1, steps + 1):
            done = env.step(int(random.integers(count(env.dims))))
            played.append((as_frame(env.picture(), channels), done.reward))
            if done.terminated or done.truncated:
                env.reset(step)
                played.append((as_frame(env.picture(), channels), 0.0))
    except RobotFault as error:
        raise ConfigError(f"{task_name} cannot be a task: {error}") from error
    frames = [frame for frame, _ in played]
    blind = why_blind(frames)
    if blind is not None:
        hint = f": {SYMBOLS}" if is_dark(frames) and not env.renders else ""
        raise ConfigError(
            f"{task_name} shows nothing to learn from: {blind} (looked at {len(frames)} of them){hint}"
        )
    return played


def unlike(first: Played, again: Played) -> str | None:
    """What differs where an environment was played twice with the same seeds and actions; None: nothing."""
    if len(first) != len(again):
        return "episodes of other lengths"
    for (frame, reward), (other_frame, other_reward) in zip(first, again, strict=True):
        if not np.array_equal(frame, other_frame):
            return "other pictures"
        if reward != other_reward:
            return "other rewards"
    return None
