"""The sliding window, its servo and the target that moves by itself."""

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_robot_sim.backlash import Backlash
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.scene_robot import SceneRobot
from bpn_robot_sim.tracking import geometry, scene
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.framing import in_frame, reward_px


class TrackingRobot(SceneRobot):
    """A `Robot`: commands add up exactly, as far as the window stays in the world.

    The seed draws the target's phase (uniform) and the window's place (uniform where the whole target is
    in the frame).

    Raises:
        ConfigError: the task has other actions than this robot.
        RenderingError: OpenGL cannot be started.
    """

    def __init__(self, task: TaskSpec) -> None:
        super().__init__(task, Physics(scene.mjcf()), "window", [(len(geometry.ACTIONS_PX),)])
        self._start(phase_deg=0.0, window_px=geometry.ARC_CENTRE_PX[0])

    @property
    def terminated(self) -> bool:
        """Whether the target's centre is out of the frame."""
        return not in_frame(*self._target_px())

    @property
    def commanded_px(self) -> float:
        """The servo's goal, the window's centre in x."""
        return self._commanded_px

    def reset(self, seed: int) -> Frame:
        """Target and window where the seed puts them, the window at rest; see `Robot.reset`."""
        self._start(*geometry.start(seed), seed)
        return self.frame()

    def command(self, action: int) -> None:
        """Moves the window's goal, up to the world's ends; see `Robot.command`."""
        self._set_goal(self._goal_after(check_action(self.task, action)))

    def settle(self) -> None:
        """One control period: the target's motion goes on, the window's is done well before."""
        self.advance(self.task.control_period_s)

    def advance(self, seconds: float) -> None:
        self._physics.advance(seconds)
        self._place_target()

    def reward(self) -> float:
        """Minus the distance of the target's and the frame's centres in pixels; see `framing`."""
        return reward_px(*self._target_px())

    def info(self) -> Info:
        """The target in the image, the target and the window's centre in the world, all (x, y) in pixels."""
        return {
            "target_px": self._target_px(),
            "target_world_px": geometry.target_world_px(self._phase_deg()),
            "window_world_px": (self._window_px(), geometry.WINDOW_Y_PX),
        }

    def greedy_action(self) -> int:
        """The action that brings the window closest to where the target will be after the next step."""
        x_px, _ = geometry.target_world_px(self._phase_deg() + geometry.DEG_PER_STEP)
        misses_px = [
            abs(self._goal_after(action) - x_px) for action in range(self.task.joint_actions)
        ]
        return int(np.argmin(misses_px))

    def _start(self, phase_deg: float, window_px: float, seed: int = 0) -> None:
        self._start_phase_deg = phase_deg
        self._backlash = Backlash(self.task.disturbances, seed, [window_px])
        self._physics.reset()
        self._set_goal(window_px)
        self._physics.data.qpos[:] = self._physics.data.ctrl
        self._place_target()

    def _goal_after(self, action: int) -> float:
        return geometry.clipped_to_world(self._commanded_px + geometry.ACTIONS_PX[action])

    def _set_goal(self, window_px: float) -> None:
        self._commanded_px = window_px
        (output_px,) = self._backlash.output([window_px])
        self._physics.data.ctrl[0] = output_px / geometry.PX_PER_M

    def _place_target(self) -> None:
        target_px = geometry.target_world_px(self._phase_deg())
        self._physics.data.mocap_pos[0, :2] = geometry.to_world_m(target_px)
        self._physics.update()

    def _phase_deg(self) -> float:
        return self._start_phase_deg + geometry.DEG_PER_S * float(self._physics.data.time)

    def _window_px(self) -> float:
        return float(self._physics.data.qpos[0]) * geometry.PX_PER_M

    def _target_px(self) -> tuple[float, float]:
        return geometry.to_image(geometry.target_world_px(self._phase_deg()), self._window_px())
