"""Two pan-tilt units with position servos: one carries the camera, the other the marker."""

from math import degrees, radians

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_robot_sim.backlash import Backlash
from bpn_robot_sim.pan_tilt import backdrop, geometry, scene
from bpn_robot_sim.pan_tilt.geometry import Angles
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.scene_robot import SceneRobot
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.framing import BORDER_PX, in_frame, reward_px
from bpn_tasks.markers import PAN_TILT_MARKER


class PanTiltRobot(SceneRobot):
    """A `Robot`: angles are commanded in whole degrees, which add up exactly, up to the unit's limits.

    The agent starts at zero angles. The seed draws the phase of the marker's figure-8, uniform where the
    whole marker is in the frame.

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, task: TaskSpec) -> None:
        physics = Physics(scene.mjcf(), {"backdrop": backdrop.pixels()})
        super().__init__(task, physics, "eye", geometry.WAYS)
        model = physics.model
        self._camera_id, self._marker_id = model.camera("eye").id, model.body("marker").id
        self._start(phase_deg=0.0)

    @property
    def terminated(self) -> bool:
        """Whether the marker's centre is out of the frame."""
        return not in_frame(*self._marker_px())

    @property
    def commanded_deg(self) -> Angles:
        """The goals of the agent's servos, (pan, tilt)."""
        return self._commanded_deg

    def reset(self, seed: int) -> Frame:
        """The agent at rest in the middle, the marker where the seed puts it; see `Robot.reset`."""
        random = np.random.default_rng(seed)
        while True:
            self._start(float(random.uniform(0, 360)), seed)
            if self._marker_is_whole():
                return self.frame()

    def command(self, action: int) -> None:
        """Turns the goals of the agent's servos, up to their limits; see `Robot.command`."""
        self._set_goal(self._goal_after(check_action(self.task, action)))

    def settle(self) -> None:
        """One control period: the marker's motion goes on, the agent's is done before."""
        self.advance(self.task.control_period_s)

    def advance(self, seconds: float) -> None:
        self._physics.advance(seconds, self._drive_target)

    def reward(self) -> float:
        """Minus the distance of the marker's and the frame's centres in pixels; see `framing`."""
        return reward_px(*self._marker_px())

    def info(self) -> Info:
        """The marker in the image (x, y) in pixels, both units' joints (pan, tilt) in degrees."""
        angles_deg = [degrees(angle) for angle in self._physics.data.qpos.tolist()]
        return {
            "target_px": self._marker_px(),
            "agent_deg": (angles_deg[0], angles_deg[1]),
            "target_deg": (angles_deg[2], angles_deg[3]),
        }

    def greedy_action(self) -> int:
        """The action that points the camera closest to where the marker's goal will be after the next step."""
        next_deg = self._phase_deg() + geometry.PHASE_PER_S * self.task.control_period_s
        aim_deg = geometry.aim_deg(geometry.marker_m(geometry.target_deg(next_deg)))
        goals_deg = np.array(
            [self._goal_after(action) for action in range(self.task.joint_actions)]
        )
        return int(np.argmin(np.linalg.norm(goals_deg - aim_deg, axis=1)))

    def _start(self, phase_deg: float, seed: int = 0) -> None:
        self._start_phase_deg = phase_deg
        self._physics.reset()
        self._backlash = Backlash(self.task.disturbances, seed, (0.0, 0.0))
        self._set_goal((0.0, 0.0))
        self._drive_target()
        data = self._physics.data
        data.qpos[:] = data.ctrl
        data.qvel[2:] = [radians(speed) for speed in geometry.target_deg_per_s(phase_deg)]
        self._physics.update()

    def _goal_after(self, action: int) -> Angles:
        pan, tilt = (
            min(max(angle + turn, -limit), limit)
            for angle, turn, limit in zip(
                self._commanded_deg,
                geometry.turns_deg(self.task.choices(action)),
                geometry.AGENT_LIMITS_DEG,
                strict=True,
            )
        )
        return pan, tilt

    def _set_goal(self, agent_deg: Angles) -> None:
        self._commanded_deg = agent_deg
        outputs_deg = self._backlash.output(agent_deg)
        self._physics.data.ctrl[:2] = [radians(angle) for angle in outputs_deg]

    def _drive_target(self) -> None:
        goal_deg = geometry.target_deg(self._phase_deg())
        self._physics.data.ctrl[2:] = [radians(angle) for angle in goal_deg]

    def _phase_deg(self) -> float:
        return self._start_phase_deg + geometry.PHASE_PER_S * float(self._physics.data.time)

    def _marker_px(self) -> tuple[float, float]:
        data = self._physics.data
        return geometry.to_image(
            data.xpos[self._marker_id],
            data.cam_xpos[self._camera_id],
            data.cam_xmat[self._camera_id].reshape(3, 3),
        )

    def _marker_is_whole(self) -> bool:
        margin_px = PAN_TILT_MARKER.radius_px
        return all(
            margin_px <= coordinate_px <= BORDER_PX - margin_px
            for coordinate_px in self._marker_px()
        )
