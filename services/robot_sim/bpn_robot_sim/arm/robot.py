"""The arm with four joints under its top camera."""

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot_sim.arm import geometry, scene
from bpn_robot_sim.planar_arm.robot import PlanarArm
from bpn_robot_sim.planar_arm.scene import BASE_PX, to_world
from bpn_shared.spec.tasks import TaskSpec


class ArmRobot(PlanarArm):
    """The arm of four links, all joints of which an action turns. The seed draws where the target is.

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, task: TaskSpec) -> None:
        dims = (len(geometry.TURNS_DEG),) * len(geometry.LINK_LENGTHS_PX)
        self._target_px = BASE_PX
        super().__init__(task, scene.mjcf(), [dims], geometry.START_DEG)

    @property
    def target_px(self) -> tuple[float, float]:
        return self._target_px

    def reset(self, seed: int) -> Frame:
        """The start pose, at rest, and a target; see `Robot.reset`."""
        self._start(seed)
        return self.frame()

    def _start(self, seed: int = 0) -> None:
        random = np.random.default_rng(seed)
        angle_deg = random.uniform(*geometry.TARGET_ANGLES_DEG)
        self._target_px = geometry.target_px(
            angle_deg, random.uniform(*geometry.TARGET_DISTANCES_PX)
        )
        super()._start(seed)
        self._physics.data.mocap_pos[0, :2] = to_world(*self._target_px)
        self._physics.update()

    def _turns_deg(self, choices: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(geometry.TURNS_DEG[choice] for choice in choices)
