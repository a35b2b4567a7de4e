"""The simulated robots by task; MuJoCo, Gymnasium and OpenGL are loaded when one is made."""

from pkgutil import resolve_name
from typing import Any

from bpn_robot.frame import is_flat
from bpn_robot.robot import Robot
from bpn_robot_sim.rendering import RenderingError
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import Task, is_gym, task_named

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
