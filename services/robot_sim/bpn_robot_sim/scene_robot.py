"""What robots of MuJoCo scenes have alike."""

from collections.abc import Sized

from bpn_robot.frame import Frame
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.rendering import Camera
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import TaskSpec


class SceneRobot:
    """A scene with one camera; nothing but the task's own rule ends an episode, and no one judges it.

    Args:
        camera: its name in the model.
        actions: those that the robot has.

    Raises:
        ConfigError: the task has other actions.
        RenderingError: OpenGL cannot be started.
    """

    truncated = False
    success = None
    has_backlash = True

    def __init__(self, task: TaskSpec, physics: Physics, camera: str, actions: Sized) -> None:
        if task.actions != len(actions):
            raise ConfigError(
                f"task {task.name!r} has {task.actions} actions, its robot {task.robot!r} has {len(actions)}"
            )
        self.task = task
        self._physics = physics
        self._camera = Camera(physics.model, camera, task.frame_channels, task.frame_px)

    def frame(self) -> Frame:
        return self._camera.render(self._physics.data)

    def close(self) -> None:
        self._camera.close()
