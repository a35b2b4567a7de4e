"""A task of one's own: a dot has to come to the middle of the picture.

What the parts may and must do is written at `TaskSpec`, `Robot` (bpn_robot.robot) and `RewardFunction`, and
`bpn.testing.check_task(centre())` looks whether they do.
"""

import numpy as np

from bpn_shared.spec.rewards import Frames, RewardError, Rewards
from bpn_shared.spec.tasks import TaskSpec

SIZE_PX, RADIUS_PX, STEP_PX = 84, 4, 8
MIDDLE_PX = (SIZE_PX - 1) / 2
MOVES = {"left": (-1, 0), "right": (1, 0), "up": (0, -1), "down": (0, 1), "stay": (0, 0)}


def centre() -> TaskSpec:
    """What every service is told of the task: data alone."""
    return TaskSpec(
        name="centre",
        title="Dot to the centre",
        robot="dot",
        rewards="dot",
        reward_unit="px",
        frame_channels=1,
        action_names=tuple(MOVES),
        hold_action=list(MOVES).index("stay"),
        control_period_s=0.1,
        success="last_reward",
        success_reward=-float(STEP_PX),
        preset={"steps": 15, "iterations": 20, "hidden_units": 64, "relative_targets": True},
    )


class Dot:
    """The robot: a simulated one needs no more than this; a real one moves motors and reads a camera."""

    terminated = truncated = False
    success = None

    def __init__(self, task: TaskSpec) -> None:
        self.task = task
        self._at = self._goal = np.full(2, MIDDLE_PX)

    def reset(self, seed: int) -> Frames:
        """Somewhere in the picture: where, the seed says."""
        self._at = np.random.default_rng(seed).uniform(RADIUS_PX, SIZE_PX - 1 - RADIUS_PX, 2)
        self._goal = self._at
        return self.frame()

    def command(self, action: int) -> None:
        """A new goal; nothing moves yet."""
        if not 0 <= action < len(MOVES):
            raise ValueError(f"action = {action} is outside 0..{len(MOVES) - 1}")
        move = np.array(tuple(MOVES.values())[action])
        self._goal = np.clip(self._at + STEP_PX * move, RADIUS_PX, SIZE_PX - 1 - RADIUS_PX)

    def settle(self) -> None:
        """In lockstep: until it is there."""
        self._at = self._goal

    def advance(self, seconds: float) -> None:
        """In realtime pacing: as far as it comes in that time, which is all the way."""
        del seconds
        self._at = self._goal

    def stop(self) -> None:
        """Stays where it is."""
        self._goal = self._at

    def frame(self) -> Frames:
        """What its camera sees now, uint8[1, 84, 84]."""
        y_px, x_px = np.mgrid[:SIZE_PX, :SIZE_PX]
        inside = np.hypot(x_px - self._at[0], y_px - self._at[1]) <= RADIUS_PX
        return np.where(inside, 255, 20).astype(np.uint8)[None]

    def reward(self) -> float:
        """What the robot itself knows; this task's rewards come from the pixels."""
        return -float(np.hypot(*(self._at - MIDDLE_PX)))

    def info(self) -> dict[str, tuple[float, float]]:
        """The truth behind it."""
        return {"dot_px": (float(self._at[0]), float(self._at[1]))}

    def close(self) -> None:
        """Nothing is open."""


def rewards(frames: Frames, task: TaskSpec) -> Rewards:
    """Minus the dot's distance from the middle in pixels, in every frame but the first."""
    found = []
    for number, frame in enumerate(frames[1:], 1):
        y_px, x_px = np.nonzero(frame[0] == 255)
        if len(x_px) == 0:
            raise RewardError(f"frame {number} of task {task.name!r} shows no dot")
        found.append(-np.hypot(x_px.mean() - MIDDLE_PX, y_px.mean() - MIDDLE_PX))
    return np.array(found)
