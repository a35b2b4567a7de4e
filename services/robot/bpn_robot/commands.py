"""What a robot is commanded: actions, hold where none came in time, and stop where nobody is to be obeyed."""

from bpn_robot.robot import Robot
from bpn_shared.counters import Counters


class Commands:
    """Commands a robot. At first it is stopped: nobody knows what it did before.

    Args:
        counters: `stops_failed` is counted here.
    """

    def __init__(self, robot: Robot, counters: Counters) -> None:
        self._robot, self._counters = robot, counters
        self._hold_action = robot.task.hold_action
        self._stopped = False
        self.stop()

    def act(self, action: int) -> int:
        """Commands an action, and returns it.

        Raises:
            RobotFault, ValueError: as `Robot.command`.
        """
        self._stopped = False
        self._robot.command(action)
        return action

    def hold(self) -> int:
        """Commands the task's hold action, and returns it."""
        return self.act(self._hold_action)

    def begin(self) -> None:
        """An episode begins, whose reset may move the robot."""
        self._stopped = False

    def stop(self) -> None:
        """Has the robot come to rest, unless it is stopped. One that cannot is told of, and told again."""
        if self._stopped:
            return
        try:
            self._robot.stop()
            self._stopped = True
        except Exception as error:
            self._counters.fault("stops_failed", "stopping the robot", error)
