"""What robots of MuJoCo scenes have alike."""

from bpn_robot.frame import Frame
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.rendering import Camera
from bpn_shared.spec.tasks import Task


class SceneRobot:
    """A scene with one camera; nothing but the task's own rule ends an episode, and no one judges it.

    Args:
        camera: its name in the model.

    Raises:
        RenderingError: OpenGL cannot be started.
    """

    truncated = False
    success = None

    def __init__(self, task: Task, physics: Physics, camera: str) -> None:
        self.task = task
        self._physics = physics
        self._camera = Camera(physics.model, camera, task.frame_channels)

    def frame(self) -> Frame:
        return self._camera.render(self._physics.data)

    def close(self) -> None:
        self._camera.close()
