"""Every task's robot as a Gymnasium environment."""

import operator
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from bpn_robot.frame import Frame
from bpn_robot.robot import Info
from bpn_robot_sim.robots import make_robot
from bpn_shared.spec.joint_actions import joined


class RobotEnv(gymnasium.Env[Frame, Any]):
    """One step is one action, the physics until the servos have settled, and one frame.

    An action is Discrete, or MultiDiscrete where the task's has several dimensions.
    Observation uint8[c, 84, 84]; reward in pixels (paper, section V-A), the distance after the move, negated.
    Terminated is the task's own end, a lost target; reaching has none. The environment has no time limit
    of its own: the registered one truncates.

    Args:
        task_name: an installed task.
        render_mode: None or "rgb_array" (`render` then gives uint8[84, 84, 3]).
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's own form

    def __init__(self, task_name: str, render_mode: str | None = None) -> None:
        self.robot = make_robot(task_name)
        task = self.robot.task
        self.render_mode = render_mode
        self.observation_space = gymnasium.spaces.Box(0, 255, task.frame_shape, np.uint8)
        self.action_space: gymnasium.spaces.Space[Any] = (
            gymnasium.spaces.Discrete(task.actions)
            if len(task.dims) == 1
            else gymnasium.spaces.MultiDiscrete(list(task.dims))
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Frame, Info]:
        super().reset(seed=seed, options=options)
        start_seed = int(self.np_random.integers(2**63)) if seed is None else seed
        frame = self.robot.reset(start_seed)
        return frame, self.robot.info()

    def step(
        self, action: np.int64 | int | Sequence[int] | npt.NDArray[np.integer]
    ) -> tuple[Frame, float, bool, bool, Info]:
        dims = self.robot.task.dims
        if len(dims) > 1 and isinstance(action, Sequence | np.ndarray):
            action = joined([operator.index(choice) for choice in action], dims)
        self.robot.command(operator.index(action))  # type: ignore[arg-type]
        self.robot.settle()
        frame = self.robot.frame()
        return frame, self.robot.reward(), self.robot.terminated, False, self.robot.info()

    def render(self) -> npt.NDArray[np.uint8]:
        planes = self.robot.frame()
        return np.ascontiguousarray(
            np.broadcast_to(planes, (3, *planes.shape[1:])).transpose(1, 2, 0)
        )

    def close(self) -> None:
        self.robot.close()
