"""What a simulated robot is to the service and to the Gymnasium environment."""

from pkgutil import resolve_name
from typing import Any, Protocol

from bpn_robot.frame import Frame, is_flat
from bpn_robot_sim.rendering import RenderingError
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import Task, is_gym, task_named

Info = dict[str, tuple[float, float]]


class RobotFault(RuntimeError):  # noqa: N818 - what the bus calls it too
    """The robot cannot go on with this episode; the message says what happened."""


class Robot(Protocol):
    """A robot with its camera.

    In lockstep one step is `command`, `settle`, `frame`; in realtime pacing it is `command` when an
    action came in time, `advance(control period)`, `frame`. `settle` takes as long as the servos need where
    nothing else moves; where the target moves too, exactly one control period, in which they are done.
    Equal seeds and calls give equal frames. A frame is a new contiguous uint8[c, 84, 84]
    (`task.frame_shape`).
    """

    @property
    def task(self) -> Task: ...

    @property
    def terminated(self) -> bool:
        """Whether the episode has ended by the task's own rule; time limits are not among them."""

    @property
    def truncated(self) -> bool:
        """Whether the episode has to end before its time for no reason of the task's, as a simulator may say."""

    @property
    def success(self) -> bool | None:
        """What the environment says of the episode so far; None where it does not say."""

    def reset(self, seed: int) -> Frame:
        """Starts an episode at the start that belongs to the seed, and returns its first frame."""

    def command(self, action: int) -> None:
        """Gives the servos a new goal; nothing moves yet.

        Raises:
            ValueError: the task has no such action.
        """

    def settle(self) -> None:
        """Lets time pass until the servos have reached their goal, at least."""

    def advance(self, seconds: float) -> None:
        """Lets that much time pass, settled or not."""

    def frame(self) -> Frame:
        """What the camera sees now."""

    def reward(self) -> float:
        """The reward of the last step: the paper's in pixels from the simulation's truth, or the environment's."""

    def info(self) -> Info:
        """The simulation's truth behind the reward, by name; names carry units."""

    def close(self) -> None:
        """Frees the camera's OpenGL context."""


def check_action(task: Task, action: int) -> int:
    """The action as an int.

    Raises:
        ValueError: it is outside 0..|A|-1.
    """
    if not 0 <= action < task.actions:
        raise ValueError(
            f"action = {action} is outside 0..{task.actions - 1}, the actions of {task.name!r}"
        )
    return int(action)


_ROBOTS = {
    "reaching": "bpn_robot_sim.reaching.robot:ReachingRobot",
    "tracking": "bpn_robot_sim.tracking.robot:TrackingRobot",
    "pan_tilt": "bpn_robot_sim.pan_tilt.robot:PanTiltRobot",
}


def make_robot(task_name: str) -> Robot:
    """A new robot for the task of that name.

    Raises:
        ValueError: the task is unknown, or has no simulated robot.
        RenderingError: OpenGL cannot be started.
    """
    task = task_named(task_name)
    if task.name not in _ROBOTS:
        raise ValueError(f"task {task.name!r} has no simulated robot")
    robot: Robot = resolve_name(_ROBOTS[task.name])()  # by name: it imports this module
    return robot


def robot_for(task: Task) -> Robot:
    """A new robot for a run's task.

    Raises:
        ConfigError: a Gymnasium environment cannot be the task, or what it needs is not installed.
        RenderingError: OpenGL cannot be started.
    """
    if not is_gym(task.name):
        robot = make_robot(task.name)
        if is_flat(robot.reset(0)):
            raise RenderingError(RuntimeError("its pictures have one colour only"))
        return robot
    of_environment: Robot = of_gym("GymRobot")(task)
    return of_environment


def of_gym(name: str) -> Any:
    """An object that `gym_robot` has, which needs an extra.

    Raises:
        ConfigError: the extra is not installed.
    """
    try:
        return resolve_name(f"bpn_robot_sim.gym_robot:{name}")
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"gym: tasks need {error.name}, which is not installed: pip install 'bpn-robot-sim[gym]'"
        ) from error
