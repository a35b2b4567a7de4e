"""A planar arm with position servos under its top camera."""

from abc import abstractmethod
from collections.abc import Sequence
from math import degrees, dist, radians

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_robot_sim.backlash import Backlash
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.planar_arm.scene import to_px
from bpn_robot_sim.scene_robot import SceneRobot
from bpn_shared.spec.tasks import TaskSpec

SETTLED_DEG = 0.05
SETTLED_DEG_PER_S = 1.0
_SETTLED_RAD = radians(SETTLED_DEG)
_SETTLED_RAD_PER_S = radians(SETTLED_DEG_PER_S)
_CHECK_EVERY_STEPS = 4


class PlanarArm(SceneRobot):
    """A `Robot`: joint angles are commanded in whole degrees, which add up exactly; no state ends an episode.

    Args:
        mjcf: as of `scene.mjcf`.
        dims: choices of each dimension of its actions; or several ways to choose.
        start_deg: every joint's angle where an episode begins.

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(
        self,
        task: TaskSpec,
        mjcf: str,
        dims: Sequence[tuple[int, ...]],
        start_deg: tuple[int, ...],
    ) -> None:
        super().__init__(task, Physics(mjcf), "top", dims)
        self._hand_id = self._physics.model.body("hand").id
        self._start_deg = self._commanded_deg = start_deg
        self._start()

    @property
    @abstractmethod
    def target_px(self) -> tuple[float, float]:
        """Where the target's centre is in the image."""

    @abstractmethod
    def _turns_deg(self, choices: tuple[int, ...]) -> tuple[int, ...]:
        """How far an action turns every joint."""

    @property
    def terminated(self) -> bool:
        return False

    @property
    def commanded_deg(self) -> tuple[int, ...]:
        """The servos' goals."""
        return self._commanded_deg

    def reset(self, seed: int) -> Frame:
        """The start pose, at rest; see `Robot.reset`."""
        self._start(seed)
        return self.frame()

    def command(self, action: int) -> None:
        """Turns the joints' goals; see `Robot.command`."""
        turns = self._turns_deg(self.task.choices(check_action(self.task, action)))
        self._set_goal(
            tuple(at + turn for at, turn in zip(self._commanded_deg, turns, strict=True))
        )

    def settle(self) -> None:
        """Until all joints are within 0.05 degrees of their goals and slower than 1 degree/s."""
        self._physics.advance_until(self._settled, _CHECK_EVERY_STEPS)

    def advance(self, seconds: float) -> None:
        self._physics.advance(seconds)

    def reward(self) -> float:
        """Minus the distance of hand and target in pixels."""
        return -dist(self._hand_px(), self.target_px)

    def info(self) -> Info:
        """Hand and target in pixels (x, y), joint angles in degrees (q1, q2, ...)."""
        return {
            "hand_px": self._hand_px(),
            "target_px": self.target_px,
            "joint_deg": tuple(degrees(q) for q in self._physics.data.qpos.tolist()),
        }

    def _start(self, seed: int = 0) -> None:
        self._physics.reset()
        self._backlash = Backlash(self.task.disturbances, seed, self._start_deg)
        self._set_goal(self._start_deg)
        self._physics.data.qpos[:] = self._physics.data.ctrl
        self._physics.update()

    def _set_goal(self, joint_deg: tuple[int, ...]) -> None:
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
        return to_px(x_m, y_m)
