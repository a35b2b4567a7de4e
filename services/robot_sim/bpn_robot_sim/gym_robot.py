"""Any Gymnasium environment with discrete actions and something to see, as a robot."""

import os
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Discrete
from PIL import Image

from bpn_robot_sim.rendering import Frame
from bpn_robot_sim.robot import Info, check_action
from bpn_shared.bnn.spec import IMAGE_SIZE_PX, MAX_ACTIONS
from bpn_shared.config import ConfigError
from bpn_shared.tasks import GYM_PREFIX, Task

Picture = npt.NDArray[np.uint8]

_SEEDS = 2**31  # some environments take no larger ones

# pygame, which Gymnasium's own environments draw with, looks for a display and for speakers otherwise.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")


class GymRobot:
    """A `Robot` whose world is the environment: an action is `task.frame_skip` steps of it.

    Its frames are the observations where they are images, else what it renders as `rgb_array`.

    Raises:
        ConfigError: it is not installed, or its actions or frames are none that a policy here could have.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._env, self._renders = open_environment(task.name)
        found = actions_of(self._env, task.name)
        if found != task.actions:
            raise ConfigError(
                f"{task.name} has {found} actions, the run's configuration says {task.actions}"
            )
        self._first_action = int(getattr(self._env.action_space, "start", 0))
        self._command = 0
        self._observation: Any = None
        self._reward, self._terminated, self._truncated = 0.0, False, False

    @property
    def task(self) -> Task:
        return self._task

    @property
    def terminated(self) -> bool:
        return self._terminated

    @property
    def truncated(self) -> bool:
        return self._truncated

    def reset(self, seed: int) -> Frame:
        """Starts an episode; see `Robot.reset`."""
        self._observation, _ = self._env.reset(seed=seed % _SEEDS)
        self._reward, self._terminated, self._truncated = 0.0, False, False
        return self.frame()

    def command(self, action: int) -> None:
        self._command = check_action(self._task, action)

    def settle(self) -> None:
        """The environment's steps with the action that was commanded; their rewards add up."""
        self._reward = 0.0
        for _ in range(self._task.frame_skip):
            self._observation, reward, terminated, truncated, _info = self._env.step(
                self._first_action + self._command
            )
            self._reward += float(reward)
            self._terminated, self._truncated = bool(terminated), bool(truncated)
            if terminated or truncated:
                return

    def advance(self, seconds: float) -> None:
        """Not possible: the environment has no time but its steps.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError(f"{self._task.name} cannot advance by {seconds} s")

    def frame(self) -> Frame:
        picture = self._env.render() if self._renders else self._observation
        return as_frame(np.asarray(picture, np.uint8), self._task.frame_channels)

    def reward(self) -> float:
        return self._reward

    def info(self) -> Info:
        return {}

    def close(self) -> None:
        self._env.close()


def probe_actions(task_name: str) -> int:
    """|A| of the environment, which is made and closed for it.

    Raises:
        ConfigError: it cannot be a task.
    """
    env, _ = open_environment(task_name)
    try:
        return actions_of(env, task_name)
    finally:
        env.close()


def open_environment(task_name: str) -> tuple[gymnasium.Env[Any, Any], bool]:
    """The environment, and whether it has to be rendered to be seen.

    Raises:
        ConfigError: it is not installed, or shows nothing.
    """
    env_id = task_name.removeprefix(GYM_PREFIX)
    env = _make(env_id)
    if _is_image(env.observation_space):
        return env, False
    modes = env.metadata.get("render_modes", [])
    env.close()
    if "rgb_array" not in modes:
        raise ConfigError(
            f"{task_name}: its observations are no images ({env.observation_space}) and it does not "
            "render as rgb_array; there is nothing for the policy to see"
        )
    env = _make(env_id, render_mode="rgb_array")
    try:
        env.reset(seed=0)
        env.render()
    except gymnasium.error.DependencyNotInstalled as error:
        raise ConfigError(f"{task_name} cannot be rendered: {error}") from error
    return env, True


def actions_of(env: gymnasium.Env[Any, Any], task_name: str) -> int:
    """|A|.

    Raises:
        ConfigError: actions are not discrete, or too few or too many.
    """
    space = env.action_space
    if not isinstance(space, Discrete):
        raise ConfigError(f"{task_name} has actions {space}: only discrete ones can be learned")
    if not 2 <= space.n <= MAX_ACTIONS:
        raise ConfigError(f"{task_name} has {space.n} actions, a policy has 2..{MAX_ACTIONS}")
    return int(space.n)


def as_frame(picture: Picture, channels: int) -> Frame:
    """A picture uint8[height, width] or [height, width, 1 or 3] as uint8[channels, 84, 84].

    Each pixel is the mean of the area that it covers, so that motion below a pixel is still seen.
    """
    image = Image.fromarray(picture.squeeze(-1) if picture.shape[2:] == (1,) else picture)
    image = image.convert("L" if channels == 1 else "RGB")
    small = np.asarray(image.resize((IMAGE_SIZE_PX, IMAGE_SIZE_PX), Image.Resampling.BOX))
    planes = small[np.newaxis] if channels == 1 else small.transpose(2, 0, 1)
    return np.ascontiguousarray(planes)


def _make(env_id: str, **options: Any) -> gymnasium.Env[Any, Any]:
    try:
        return gymnasium.make(env_id, **options)
    except (gymnasium.error.Error, ImportError) as error:
        raise ConfigError(f"{GYM_PREFIX}{env_id} cannot be made: {error}") from error


def _is_image(space: Any) -> bool:
    return (
        isinstance(space, Box)
        and space.dtype == np.uint8
        and (len(space.shape) == 2 or (len(space.shape) == 3 and space.shape[2] in (1, 3)))
    )
