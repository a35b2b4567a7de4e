"""Any Gymnasium environment with discrete actions and something to see, as a robot."""

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_robot_sim.environment import GymEnvironment, play_at_random
from bpn_robot_sim.pictures import as_frame
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import Task


class GymRobot:
    """A `Robot` whose world is the environment: an action is `task.frame_skip` steps of it.

    Raises:
        ConfigError: the environment cannot be the task (`probe_environment`), or has other actions than it.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._env = GymEnvironment(task.name)
        if self._env.actions != task.actions:
            self._env.close()
            raise ConfigError(
                f"{task.name} has {self._env.actions} actions, the run's configuration says {task.actions}"
            )
        try:
            play_at_random(self._env, task.name, task.frame_channels)
        except ConfigError:
            self._env.close()
            raise
        self._command = 0
        self._begin()

    def _begin(self) -> None:
        self._reward = 0.0
        self._success: bool | None = None
        self._terminated, self._truncated = False, False

    @property
    def task(self) -> Task:
        return self._task

    @property
    def terminated(self) -> bool:
        return self._terminated

    @property
    def truncated(self) -> bool:
        return self._truncated

    @property
    def success(self) -> bool | None:
        return self._success

    def reset(self, seed: int) -> Frame:
        """Starts an episode; see `Robot.reset`."""
        self._env.reset(seed)
        self._begin()
        return self.frame()

    def command(self, action: int) -> None:
        self._command = check_action(self._task, action)

    def settle(self) -> None:
        """The environment's steps with the action that was commanded; their rewards add up."""
        self._reward = 0.0
        for _ in range(self._task.frame_skip):
            step = self._env.step(self._command)
            self._reward += step.reward
            self._terminated, self._truncated = step.terminated, step.truncated
            self._success = step.success
            if step.terminated or step.truncated:
                return

    def advance(self, seconds: float) -> None:
        """Not possible: the environment has no time but its steps.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError(f"{self._task.name} cannot advance by {seconds} s")

    def frame(self) -> Frame:
        return as_frame(self._env.picture(), self._task.frame_channels)

    def reward(self) -> float:
        return self._reward

    def info(self) -> Info:
        return {}

    def close(self) -> None:
        self._env.close()
