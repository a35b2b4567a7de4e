"""The tasks that robots can do: what every service must know of each."""

import re
from dataclasses import dataclass
from typing import Literal

from bpn_shared.spec.network import IMAGE_SIZE_PX, MAX_CHANNELS, NetworkSpec

CONTROL_PERIOD_S = 0.145
"""The paper's Table II."""
RETURN_PX, RETURN = "return_px", "return"
"""Mean return of an iteration: in pixels, or of a gym: task in its environment's unit."""


@dataclass(frozen=True, slots=True)
class Task:
    """One task.

    Attributes:
        env_id: the Gymnasium id of its simulation.
        frame_channels: c of one camera frame uint8[c, 84, 84].
        frames_stacked: frames in one observation; C = frame_channels * frames_stacked.
        action_names: what each action does, with its unit; |A| of them.
        hold_action: the action that leaves the robot where it is; what a robot did when no action
            came in time (realtime pacing).
        control_period_s: time between two frames in realtime pacing.
        frame_skip: steps of a Gymnasium environment that one action takes.
        rewards: computed from the pixels by the learner (the paper, section VI-A), or told by the robot.
        success: what an episode has to do: end with the hand on the target, keep the target in the frame, or
            whatever the robot says, if it says anything.
    """

    name: str
    env_id: str
    frame_channels: int
    frames_stacked: int
    action_names: tuple[str, ...]
    hold_action: int
    control_period_s: float
    frame_skip: int = 1
    rewards: Literal["pixels", "robot"] = "pixels"
    success: Literal["reached", "kept", "told"] = "kept"

    @property
    def return_metric(self) -> str:
        """Name of the mean return in metrics: `return_px`, or `return` where its unit is the environment's."""
        return RETURN_PX if self.rewards == "pixels" else RETURN

    @property
    def return_unit(self) -> str:
        """What to print behind a return: " px", or nothing."""
        return " px" if self.rewards == "pixels" else ""

    @property
    def actions(self) -> int:
        """|A|."""
        return len(self.action_names)

    @property
    def frame_shape(self) -> tuple[int, int, int]:
        return self.frame_channels, IMAGE_SIZE_PX, IMAGE_SIZE_PX

    def network(self, nodes: int) -> NetworkSpec:
        """The geometry of this task's policy with N = nodes."""
        return NetworkSpec(self.frame_channels * self.frames_stacked, nodes, self.actions)


TASKS = {
    "reaching": Task(
        name="reaching",
        env_id="bpn/Reaching-v0",
        frame_channels=1,
        frames_stacked=1,
        action_names=tuple(
            f"joint {joint} by {turn}°"
            for joint in (1, 2)
            for turn in (-90, -45, -30, 0, 30, 45, 90)
        ),
        hold_action=3,  # joint 1 by 0 degrees
        control_period_s=CONTROL_PERIOD_S,
        success="reached",
    ),
    "tracking": Task(
        name="tracking",
        env_id="bpn/Tracking-v0",
        frame_channels=3,
        frames_stacked=2,  # "to estimate the target's velocity", section V-A-2
        action_names=tuple(f"window by {move} px" for move in (-8, -4, -2, 0, 2, 4, 8)),
        hold_action=3,  # the window by 0 px
        control_period_s=CONTROL_PERIOD_S,
    ),
    "pan_tilt": Task(
        name="pan_tilt",
        env_id="bpn/PanTilt-v0",
        frame_channels=3,
        frames_stacked=2,
        action_names=(
            *(f"tilt by {n}°" for n in (-4, -2, 0, 2, 4)),
            *(f"pan by {n}°" for n in (-4, -2, 2, 4)),
            *(f"pan by {-n}°, tilt by {n}°" for n in (-4, -2, 2, 4)),
            *(f"pan by {n}°, tilt by {n}°" for n in (-4, -2, 2, 4)),
        ),
        hold_action=2,  # both motors by 0 degrees
        control_period_s=CONTROL_PERIOD_S,
    ),
}


GYM_PREFIX = "gym:"
"""Begins the names of tasks that are any Gymnasium environment, such as gym:CartPole-v1."""

_GYM_NAME = r"gym:([A-Za-z0-9_.-]+/)?[A-Za-z0-9_.-]+"


TASK_PATTERN = f"^({'|'.join(TASKS)}|{_GYM_NAME})$"
"""Of all names that tasks may have."""
TASK_NAMES = f"{', '.join(TASKS)}, {GYM_PREFIX}ENVIRONMENT-ID"
"""For help and errors: the names that tasks may have."""


def is_gym(name: str) -> bool:
    """Whether the task is a Gymnasium environment outside of this project."""
    return name.startswith(GYM_PREFIX)


def return_metric(name: str) -> str:
    """`Task.return_metric` of the task of that name."""
    return RETURN if is_gym(name) else RETURN_PX


def check_task_name(name: str) -> str:
    """The name, if a task may have it.

    Raises:
        ValueError: no task is named so; the message lists those there are.
    """
    if not re.fullmatch(TASK_PATTERN, name):
        raise ValueError(f"unknown; one of: {TASK_NAMES}")
    return name


def task_named(name: str) -> Task:
    """One of the paper's tasks.

    Raises:
        ValueError: there is none of that name; the message lists those there are.
    """
    try:
        return TASKS[name]
    except KeyError:
        raise ValueError(f"task = {name!r} is unknown; one of: {', '.join(TASKS)}") from None


def gym_task(
    name: str, *, frame_channels: int, frames_stacked: int, frame_skip: int, actions: int
) -> Task:
    """The Gymnasium environment of that name as a task.

    Raises:
        ValueError: a value is impossible, or still missing (0).
    """
    if actions < 2:
        raise ValueError(
            f"actions = {actions}: give the number of actions of {name!r} (`bpn train` finds it out)"
        )
    if frame_channels not in (1, 3):
        raise ValueError(f"frame_channels = {frame_channels} must be 1 (gray) or 3 (RGB)")
    if not 1 <= frame_channels * frames_stacked <= MAX_CHANNELS:
        raise ValueError(
            f"frames_stacked = {frames_stacked} of {frame_channels} channels: an observation has at most "
            f"{MAX_CHANNELS} channels"
        )
    return Task(
        name=name,
        env_id=name.removeprefix(GYM_PREFIX),
        frame_channels=frame_channels,
        frames_stacked=frames_stacked,
        action_names=tuple(f"action {number}" for number in range(actions)),
        hold_action=0,  # without a meaning: these tasks have no realtime pacing
        control_period_s=CONTROL_PERIOD_S,
        frame_skip=frame_skip,
        rewards="robot",
        success="told",
    )
