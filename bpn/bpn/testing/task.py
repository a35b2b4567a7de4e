"""A task's parts beside each other: they are installed here, load, and agree."""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from bpn import optional
from bpn.testing.answers import CheckedRobot
from bpn.testing.robot import Played, examine
from bpn_robot.robots import make_robot
from bpn_shared.errors import InputError, one_line
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.rewards import Frames, RewardFunction, Rewards, reward_function
from bpn_shared.spec.tasks import TaskSpec, is_gym

T = TypeVar("T")


def check_task(spec: TaskSpec, *, steps: int = 30, seed: int = 0, repeatable: bool = True) -> None:
    """Holds a task to `TaskSpec` and `RewardFunction`, and its robot to `Robot`, as `check_robot` does.

    Robot, rewards and plot that it names have to be installed here. Rewards are computed of what the robot shows.

    Args:
        spec: what the entry point's function returns.
        steps: see `check_robot`.
        seed: see `check_robot`.
        repeatable: see `check_robot`.

    Raises:
        AssertionError: something is missing, broken, or does not agree; the message is one sentence.
    """
    who = f"task {spec.name!r}"
    _check_data(spec, who)
    if spec.plot is not None:
        plots = optional.load("bpn.evaluation.plot", extra="media", wanted_by="check_task")
        _call(who, plots.plot_of, spec)
    rewards = _call(who, reward_function, spec)
    robot = CheckedRobot(_call(who, make_robot, spec), repeatable)
    try:
        assert robot.task == spec, (
            f"{who}: its robot's task is another: {_unlike(spec, robot.task)}"
        )
        episodes = examine(robot, steps, seed)
    finally:
        robot.close()
    if rewards is not None:
        for episode in episodes:
            _check_rewards(rewards, episode, spec, who)
    if spec.success == "told" and not is_gym(spec.name):  # any environment's, which may say nothing
        assert any(episode.success is not None for episode in episodes), (
            f"{who}: success = 'told', but its robot {spec.robot!r} never says; or else it is 'undefined'"
        )


def _check_data(spec: TaskSpec, who: str) -> None:
    """What a specification shows without its parts."""
    for number in spec.preset.values():
        assert not isinstance(number, float) or math.isfinite(number), (
            f"{who}: preset has {number}, which is not finite"
        )
    taken = {"task", "task_spec"} & spec.preset.keys()
    assert not taken, f"{who}: preset has {', '.join(sorted(taken))}, which its name says already"
    _call(f"{who}, preset", RunConfig.parse, spec.preset | {"task": spec.name, "task_spec": spec})


def _check_rewards(function: RewardFunction, episode: Played, spec: TaskSpec, who: str) -> None:
    frames = np.stack(episode.frames)
    frames.setflags(write=False)
    rewards = _computed(function, frames, spec, who)
    wrong = np.flatnonzero(~np.isfinite(rewards))
    assert len(wrong) == 0, (
        f"{who}: rewards {spec.rewards!r} are {rewards[wrong[0]]} at step {wrong[0] + 1} of seed {episode.seed}, "
        "not finite"
    )
    assert np.array_equal(_computed(function, frames, spec, who), rewards), (
        f"{who}: rewards {spec.rewards!r} of the same {len(frames)} frames are others when computed again"
    )
    assert np.array_equal(_computed(function, frames[:2], spec, who), rewards[:1]), (
        f"{who}: rewards {spec.rewards!r} are another at step 1 where the episode ends there than where it goes on"
    )


def _computed(function: RewardFunction, frames: Frames, spec: TaskSpec, who: str) -> Rewards:
    return _call(f"{who}, rewards of {len(frames)} frames of its robot", function, frames, spec)


def _unlike(spec: TaskSpec, other: TaskSpec) -> str:
    ours, theirs = dict(spec), dict(other)
    name = next(name for name in ours if ours[name] != theirs[name])
    return f"{name} = {theirs[name]!r}, not {ours[name]!r}"


def _call(who: str, function: Callable[..., T], *args: Any) -> T:
    try:
        return function(*args)
    except InputError as error:
        said = "; ".join(str(error).splitlines())
        raise AssertionError(f"{who}: {said}") from error
    except Exception as error:
        raise AssertionError(f"{who}: {one_line(error)}") from error
