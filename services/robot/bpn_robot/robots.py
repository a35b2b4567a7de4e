"""Robots by the name that a task's specification gives: plug-ins of the group bpn.robots, installed here."""

from bpn_robot.disturbed import DisturbedRobot
from bpn_robot.robot import Robot
from bpn_shared import plugins
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.disturbances import of_scope
from bpn_shared.spec.tasks import TaskSpec


def make_robot(task: TaskSpec) -> Robot:
    """A new robot for a task: what the plug-in's function makes of the specification, with the camera it says.

    Raises:
        PluginError: the robot is not installed here, or its plug-in cannot be imported.
        ConfigError: the robot cannot be stopped, or the task wants backlash of servos that are not simulated.
        Exception: whatever a robot may fail with when it is made, as its maker says.
    """
    robot: Robot = plugins.load(plugins.ROBOTS, task.robot)(task)
    if not callable(getattr(robot, "stop", None)):
        robot.close()
        raise ConfigError(
            f"robot {task.robot!r} cannot be stopped: give it a method stop(), which brings it to rest "
            "(docs/own-robot.md)"
        )
    if of_scope(task.disturbances, "servo") and not getattr(robot, "has_backlash", False):
        robot.close()
        raise ConfigError(
            f"disturbances of {task.name!r}: the servos of its robot {task.robot!r} have no backlash to choose; "
            "leave it out"
        )
    return DisturbedRobot(robot) if of_scope(task.disturbances, "picture") else robot
