"""Any robot, seen through a disturbed camera."""

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, Robot
from bpn_shared.camera.disturbed import EpisodeCamera
from bpn_shared.spec.disturbances import of_scope
from bpn_shared.spec.tasks import TaskSpec


class DisturbedRobot:
    """A `Robot` whose frames are those of another, disturbed as its task says; all else is the other's.

    A step's frame is disturbed in the same way however often it is asked for.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._levels = of_scope(robot.task.disturbances, "picture")
        self._camera = EpisodeCamera(self._levels, 0)
        self._step, self._moved = 0, False

    @property
    def task(self) -> TaskSpec:
        return self._robot.task

    @property
    def terminated(self) -> bool:
        return self._robot.terminated

    @property
    def truncated(self) -> bool:
        return self._robot.truncated

    @property
    def success(self) -> bool | None:
        return self._robot.success

    def reset(self, seed: int) -> Frame:
        """Starts an episode, with what the seed draws of the disturbances; see `Robot.reset`."""
        self._camera = EpisodeCamera(self._levels, seed)
        self._step, self._moved = 0, False
        return self._camera.picture(self._robot.reset(seed), 0)

    def command(self, action: int) -> None:
        self._robot.command(action)

    def settle(self) -> None:
        self._moved = True
        self._robot.settle()

    def advance(self, seconds: float) -> None:
        self._moved = True
        self._robot.advance(seconds)

    def stop(self) -> None:
        self._robot.stop()

    def frame(self) -> Frame:
        self._step += self._moved
        self._moved = False
        return self._camera.picture(self._robot.frame(), self._step)

    def reward(self) -> float:
        return self._robot.reward()

    def info(self) -> Info:
        return self._robot.info()

    def close(self) -> None:
        self._robot.close()
