"""Robots by the name that a task's specification gives: plug-ins of the group bpn.robots, installed here."""

from bpn_robot.robot import Robot
from bpn_shared import plugins
from bpn_shared.spec.tasks import TaskSpec


def make_robot(task: TaskSpec) -> Robot:
    """A new robot for a task: what the plug-in's function makes of the specification.

    Raises:
        PluginError: the robot is not installed here, or its plug-in cannot be imported.
        Exception: whatever a robot may fail with when it is made, as its maker says.
    """
    robot: Robot = plugins.load(plugins.ROBOTS, task.robot)(task)
    return robot
