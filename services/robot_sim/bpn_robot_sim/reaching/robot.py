"""The 2-DOF arm with position servos under its top camera."""

from bpn_robot_sim.planar_arm.robot import PlanarArm
from bpn_robot_sim.reaching import geometry, scene
from bpn_shared.spec.tasks import TaskSpec


class ReachingRobot(PlanarArm):
    """The arm of two links: an action turns one joint, or both where the task's actions have two dimensions.

    Start and target are fixed (the paper, section V-A-1), so the seed changes nothing but the servos' backlash,
    if there is any.

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, task: TaskSpec) -> None:
        turns = len(geometry.ROTATIONS_DEG)
        ways = (len(geometry.ACTIONS_DEG),), (turns, turns)
        super().__init__(task, scene.mjcf(), ways, geometry.START_DEG)

    @property
    def target_px(self) -> tuple[float, float]:
        return geometry.TARGET_PX

    def _turns_deg(self, choices: tuple[int, ...]) -> tuple[int, ...]:
        if len(choices) == 1:
            return geometry.ACTIONS_DEG[choices[0]]
        return tuple(geometry.ROTATIONS_DEG[choice] for choice in choices)
