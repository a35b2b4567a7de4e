"""What robots of MuJoCo scenes have alike."""

from collections.abc import Sequence

from bpn_robot.frame import Frame
from bpn_robot_sim.physics import Physics
from bpn_robot_sim.rendering import Camera
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import TaskSpec


class SceneRobot:
    """A scene with one camera; nothing but the task's own rule ends an episode, and no one judges it.

    Args:
        camera: its name in the model.
        ways: of which its actions may be, the choices of each dimension.

    Raises:
        ConfigError: the task has other actions.
        RenderingError: OpenGL cannot be started.
    """

    truncated = False
    success = None
    has_backlash = True

    def __init__(
        self, task: TaskSpec, physics: Physics, camera: str, ways: Sequence[tuple[int, ...]]
    ) -> None:
        if task.dims not in ways:
            raise ConfigError(
                f"task {task.name!r} has {_counted(task.dims)} actions, its robot {task.robot!r} has "
                f"{' or '.join(map(_counted, ways))}"
            )
        self.task = task
        self._physics = physics
        self._camera = Camera(physics.model, camera, task.frame_channels, task.frame_px)

    def frame(self) -> Frame:
        return self._camera.render(self._physics.data)

    def stop(self) -> None:
        """Nothing to do: its servos come to rest at their goals, and hold them."""

    def close(self) -> None:
        self._camera.close()


def _counted(dims: tuple[int, ...]) -> str:
    return " x ".join(map(str, dims))
