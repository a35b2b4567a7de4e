"""The simulated robots, as plug-ins; MuJoCo, Gymnasium and OpenGL are loaded when one is made."""

from pkgutil import resolve_name
from typing import Any

from bpn_robot import robots
from bpn_robot.frame import is_flat
from bpn_robot.robot import Robot
from bpn_shared.runtime.gym_modules import allowed_modules
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.tasks import TaskOptions, TaskSpec


def make_robot(task_name: str) -> Robot:
    """A new robot for an installed task, by its name.

    Raises:
        InputError: the task is unknown here, or its robot is not installed or broken.
        RenderingError: OpenGL cannot be started.
    """
    return robots.make_robot(task_spec(task_name, TaskOptions()))


def reaching(task: TaskSpec) -> Robot:
    """The arm under its top camera.

    Raises:
        ConfigError: the task has other actions or frames than this robot.
        RenderingError: OpenGL cannot be started, or draws nothing.
    """
    return _of_scene("bpn_robot_sim.reaching.robot:ReachingRobot", task)


def tracking(task: TaskSpec) -> Robot:
    """The sliding window; raises as `reaching`."""
    return _of_scene("bpn_robot_sim.tracking.robot:TrackingRobot", task)


def pan_tilt(task: TaskSpec) -> Robot:
    """The two pan-tilt units; raises as `reaching`."""
    return _of_scene("bpn_robot_sim.pan_tilt.robot:PanTiltRobot", task)


def arm(task: TaskSpec) -> Robot:
    """The arm with four joints; raises as `reaching`."""
    return _of_scene("bpn_robot_sim.arm.robot:ArmRobot", task)


def gym(task: TaskSpec) -> Robot:
    """A Gymnasium environment, for which modules are imported that this process's environment variable allows.

    Raises:
        ConfigError: it cannot be the task, or what it needs is not installed or not allowed.
    """
    robot: Robot = of_gym("gym_robot:GymRobot")(task, allowed_modules())
    return robot


def of_gym(name: str) -> Any:
    """An object, such as gym_robot:GymRobot, of a module that needs an extra.

    Raises:
        ConfigError: the extra is not installed.
    """
    try:
        return resolve_name(f"bpn_robot_sim.{name}")
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"gym: tasks need {error.name}, which is not installed: pip install 'bpn-robot-sim[gym]'"
        ) from error


def _of_scene(name: str, task: TaskSpec) -> Robot:
    from bpn_robot_sim.rendering import RenderingError  # noqa: PLC0415 - which loads MuJoCo

    # by name: whoever looks for a task's robot loads no other's
    robot: Robot = resolve_name(name)(task)
    if is_flat(robot.reset(0)):
        robot.close()
        raise RenderingError(RuntimeError("its pictures have one colour only"))
    return robot
