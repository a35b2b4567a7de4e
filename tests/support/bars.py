"""A tiny task of a bar that moves to and fro and keeps to the contracts, and bad parts to exchange for its own."""

from typing import Any

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_shared.spec.rewards import Frames, RewardError, Rewards
from bpn_shared.spec.tasks import TaskSpec

MOVES_PX = (-10, 10, 0)


def spec(**changes: Any) -> TaskSpec:
    """The task, with other values."""
    values: dict[str, Any] = {
        "name": "bars", "robot": "bar", "rewards": "bar", "frame_channels": 1,
        "action_names": ("left", "right", "stay"), "hold_action": 2, "control_period_s": 0.1,
        "preset": {"steps": 9},
    }  # fmt: skip
    return TaskSpec.model_validate(values | changes)


class Bar:
    """Moves at 200 px/s, from a place that the seed says; at the picture's edge the episode ends."""

    truncated = False
    success: bool | None = None

    def __init__(self, task: TaskSpec) -> None:
        self.task = task
        self.at_px = self.goal_px = 42.0

    @property
    def terminated(self) -> bool:
        return not 10 <= self.at_px <= 74

    def reset(self, seed: int) -> Frame:
        self.at_px = self.goal_px = float(np.random.default_rng(seed).integers(20, 64))
        return self.frame()

    def command(self, action: int) -> None:
        self.goal_px = self.at_px + MOVES_PX[check_action(self.task, action)]

    def settle(self) -> None:
        self.at_px = self.goal_px

    def advance(self, seconds: float) -> None:
        self.at_px += float(np.clip(self.goal_px - self.at_px, -200 * seconds, 200 * seconds))

    def stop(self) -> None:
        self.goal_px = self.at_px

    def frame(self) -> Frame:
        frame = np.zeros(self.task.frame_shape, np.uint8)
        frame[:, :, max(0, round(self.at_px)) : round(self.at_px) + 3] = 255
        return frame

    def reward(self) -> float:
        return -abs(self.at_px - 42)

    def info(self) -> Info:
        return {"bar_px": (self.at_px, 42.0)}

    def close(self) -> None:
        """Nothing is open."""


class Sighted(Bar):
    """Refuses tasks of another number of actions."""

    def __init__(self, task: TaskSpec) -> None:
        if task.actions != len(MOVES_PX):
            raise OSError(5, "no camera", "/dev/video9")
        super().__init__(task)


def rewards(frames: Frames, task: TaskSpec) -> Rewards:
    """Minus how far the bar's left edge is from the middle, in every frame but the first."""
    del task
    return -abs(frames[1:, 0, 0].argmax(axis=1) - 42.0)


def infinite(frames: Frames, task: TaskSpec) -> Rewards:
    with np.errstate(divide="ignore"):
        return np.log(rewards(frames, task) * 0)


def too_many(frames: Frames, task: TaskSpec) -> Rewards:
    return rewards(np.concatenate([frames, frames[-1:]]), task)


def of_the_whole(frames: Frames, task: TaskSpec) -> Rewards:
    return rewards(frames, task) - len(frames)


def changes_its_frames(frames: Frames, task: TaskSpec) -> Rewards:
    frames[:] = 255 - frames
    return rewards(frames, task)


def at_random(frames: Frames, task: TaskSpec) -> Rewards:
    return rewards(frames, task) + np.random.default_rng().random()


def in_words(frames: Frames, task: TaskSpec) -> list[str]:
    return ["good" for _ in rewards(frames, task)]


def blind(frames: Frames, task: TaskSpec) -> Rewards:
    raise RewardError(f"frame 3 of {len(frames)} of task {task.name!r} shows no bar")


def other(task: TaskSpec) -> Bar:
    """A robot that keeps another task than that which it was made for."""
    return Bar(task.model_copy(update={"control_period_s": 0.2}))
