"""The 2-DOF arm with position servos under its top camera."""

from math import degrees, dist, radians

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_robot_sim.backlash import Backlash
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.reaching import geometry, scene
from bpn_robot_sim.scene_robot import SceneRobot
from bpn_shared.spec.tasks import TaskSpec

SETTLED_DEG = 0.05
SETTLED_DEG_PER_S = 1.0
_SETTLED_RAD = radians(SETTLED_DEG)
_SETTLED_RAD_PER_S = radians(SETTLED_DEG_PER_S)
_CHECK_EVERY_STEPS = 4


class ReachingRobot(SceneRobot):
    """A `Robot`: joint angles are commanded in whole degrees, which add up exactly.

    Start and target are fixed (the paper, section V-A-1), so the seed changes nothing but the servos' backlash,
    if there is any, and no state ends an episode.

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, task: TaskSpec) -> None:
        super().__init__(task, Physics(scene.mjcf()), "top", geometry.ACTIONS_DEG)
        self._hand_id = self._physics.model.body("hand").id
        self._commanded_deg = geometry.START_DEG
        self._start()

    @property
    def terminated(self) -> bool:
        return False

    @property
    def commanded_deg(self) -> tuple[int, int]:
        """The servos' goals."""
        return self._commanded_deg

    def reset(self, seed: int) -> Frame:
        """The start pose, at rest; see `Robot.reset`."""
        self._start(seed)
        return self.frame()

    def command(self, action: int) -> None:
        """Turns one joint's goal; see `Robot.command`."""
        turn1, turn2 = geometry.ACTIONS_DEG[check_action(self.task, action)]
        self._set_goal((self._commanded_deg[0] + turn1, self._commanded_deg[1] + turn2))

    def settle(self) -> None:
        """Until both joints are within 0.05 degrees of their goals and slower than 1 degree/s."""
        self._physics.advance_until(self._settled, _CHECK_EVERY_STEPS)

    def advance(self, seconds: float) -> None:
        self._physics.advance(seconds)

    def reward(self) -> float:
        """Minus the distance of hand and target in pixels."""
        return -dist(self._hand_px(), geometry.TARGET_PX)

    def info(self) -> Info:
        """Hand and target in pixels (x, y), joint angles in degrees (q1, q2)."""
        q1, q2 = self._physics.data.qpos.tolist()
        return {
            "hand_px": self._hand_px(),
            "target_px": geometry.TARGET_PX,
            "joint_deg": (degrees(q1), degrees(q2)),
        }

    def _start(self, seed: int = 0) -> None:
        self._physics.reset()
        self._backlash = Backlash(self.task.disturbances, seed, geometry.START_DEG)
        self._set_goal(geometry.START_DEG)
        self._physics.data.qpos[:] = self._physics.data.ctrl
        self._physics.update()

    def _set_goal(self, joint_deg: tuple[int, int]) -> None:
        self._commanded_deg = joint_deg
        outputs_deg = self._backlash.output(joint_deg)
        self._physics.data.ctrl[:] = [radians(angle) for angle in outputs_deg]

    def _settled(self) -> bool:
        data = self._physics.data
        return all(
            abs(q - goal) < _SETTLED_RAD and abs(speed) < _SETTLED_RAD_PER_S
            for q, goal, speed in zip(
                data.qpos.tolist(), data.ctrl.tolist(), data.qvel.tolist(), strict=True
            )
        )

    def _hand_px(self) -> tuple[float, float]:
        x_m, y_m, _ = self._physics.data.xpos[self._hand_id].tolist()
        return geometry.to_px(x_m, y_m)
