"""Any Gymnasium environment with something to see and actions that are choices, or made so, as a robot."""

from collections import deque
from collections.abc import Collection

from bpn_robot.frame import Frame
from bpn_robot.robot import Info, check_action
from bpn_robot_sim.environment import GymEnvironment
from bpn_robot_sim.pictures import Picture, as_frame, brightest
from bpn_robot_sim.trying_out import play_at_random
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import TaskSpec


class GymRobot:
    """A `Robot` whose world is the environment: an action is `task.frame_skip` steps of it.

    Args:
        allowed: modules that may be imported for it.

    Raises:
        ConfigError: the environment cannot be the task (`probe_environment`), or has other actions than it.
    """

    def __init__(self, task: TaskSpec, allowed: Collection[str] = ()) -> None:
        self._task = task
        self._env = GymEnvironment(task.name, task.gym, allowed)
        self._pictures: deque[Picture] = deque(maxlen=task.gym.max_over_frames)
        if self._env.dims != task.dims:
            self._env.close()
            counted = (" x ".join(map(str, dims)) for dims in (self._env.dims, task.dims))
            raise ConfigError(
                f"{task.name} has {next(counted)} actions, the run's configuration says {next(counted)}"
            )
        try:
            play_at_random(self._env, task.name, task.frame_channels)
        except ConfigError:
            self._env.close()
            raise
        self._command = 0
        self._begin()

    def _begin(self) -> None:
        self._pictures.clear()
        self._reward = 0.0
        self._success: bool | None = None
        self._terminated, self._truncated = False, False

    @property
    def task(self) -> TaskSpec:
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
        self._pictures.clear()
        for left in reversed(range(self._task.frame_skip)):
            step = self._env.step(self._command)
            self._reward += step.reward
            self._terminated, self._truncated = step.terminated, step.truncated
            self._success = step.success
            ended = step.terminated or step.truncated
            if ended or left < self._task.gym.max_over_frames:
                self._pictures.append(self._env.picture().copy())
            if ended:
                return

    def advance(self, seconds: float) -> None:
        """Not possible: the environment has no time but its steps.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError(f"{self._task.name} cannot advance by {seconds} s")

    def stop(self) -> None:
        """Nothing to do: between its steps an environment stands still."""

    def frame(self) -> Frame:
        if not self._pictures:
            self._pictures.append(self._env.picture())
        task = self._task
        return as_frame(brightest(self._pictures), task.frame_channels, task.frame_px)

    def reward(self) -> float:
        return self._reward

    def info(self) -> Info:
        return {}

    def close(self) -> None:
        self._env.close()
