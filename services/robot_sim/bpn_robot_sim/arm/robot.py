"""The arm with four joints under its top camera."""

from bpn_robot.frame import Frame
from bpn_robot_sim.arm import geometry, scene
from bpn_robot_sim.planar_arm.robot import PlanarArm
from bpn_shared.spec.tasks import TaskSpec


class ArmRobot(PlanarArm):
    """The arm of four links, all joints of which an action turns. The seed draws the pose in which it starts.

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, task: TaskSpec) -> None:
        dims = (len(geometry.TURNS_DEG),) * len(geometry.LINK_LENGTHS_PX)
        super().__init__(task, scene.mjcf(), [dims], geometry.start_deg(0))

    @property
    def target_px(self) -> tuple[float, float]:
        return geometry.TARGET_PX

    def reset(self, seed: int) -> Frame:
        """The pose that belongs to the seed, at rest; see `Robot.reset`."""
        self._start_deg = geometry.start_deg(seed)
        return super().reset(seed)

    def _turns_deg(self, choices: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(geometry.TURNS_DEG[choice] for choice in choices)
