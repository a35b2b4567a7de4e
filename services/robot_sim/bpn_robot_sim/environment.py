"""A Gymnasium environment of somebody else: what it says is checked where it says it."""

import logging
import math
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium.spaces import Dict, Discrete

from bpn_robot.robot import RobotFault
from bpn_robot_sim.pictures import (
    ObservedPictures,
    Picture,
    PictureError,
    as_frame,
    rendered,
    why_blind,
)
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import MAX_ACTIONS
from bpn_shared.spec.tasks import GYM_PREFIX

log = logging.getLogger(__name__)

_SEEDS = 2**31  # some environments take no larger ones
_MAX_REASON = 300

# Without a display and speakers: pygame, which Gymnasium's own environments draw with, looks for both. `offscreen`
# draws; `dummy` would not in environments that take it for "nobody looks".
os.environ.setdefault("SDL_VIDEODRIVER", "offscreen")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")

_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Step:
    """What one step came to; `success` is None where the environment does not say."""

    reward: float
    terminated: bool
    truncated: bool
    success: bool | None


class GymEnvironment:
    """The environment, made. What it prints goes to standard error.

    Its pictures are its observations where these are images, else what it renders as `rgb_array`.

    Args:
        task_name: gym: and its id.

    Attributes:
        actions: |A|.
        renders: whether the pictures are rendered.
        note: why they are, where it has observations that are nearly images; "" otherwise.

    Raises:
        ConfigError: it is not installed or cannot be made, or its actions or pictures are none that a policy
            here could have.
    """

    def __init__(self, task_name: str) -> None:
        self._name = task_name
        self._env = self._make()
        self.renders, self.note = False, ""
        self._observed: ObservedPictures | None = None
        try:
            self.actions = _actions_of(self._env.action_space, task_name)
            self._choose_pictures()
        except BaseException:
            self.close()
            raise

    def _choose_pictures(self) -> None:
        space = self._env.observation_space
        try:
            self._observed = ObservedPictures(space)
            return
        except PictureError as error:
            why = str(error)
        metadata = getattr(self._env, "metadata", None)
        modes = metadata.get("render_modes") if isinstance(metadata, dict) else None
        if "rgb_array" not in (modes or ()):
            raise ConfigError(
                f"{self._name}: {why}, and it does not render as rgb_array; there is nothing for the policy "
                "to see"
            )
        self.close()
        self._env = self._make(render_mode="rgb_array")
        self.renders = True
        if isinstance(space, Dict) or len(space.shape or ()) > 1:  # there may be an image in it
            self.note = f"{self._name}: {why}; the policy sees what it renders"

    def _make(self, **options: Any) -> gymnasium.Env[Any, Any]:
        env_id = self._name.removeprefix(GYM_PREFIX)
        try:
            return self._quietly(lambda: gymnasium.make(env_id, **options))
        except Exception as error:  # whatever its constructor raises
            raise ConfigError(f"{self._name} cannot be made: {last_line(error)}") from error

    @staticmethod
    def _quietly(call: Callable[[], _Result]) -> _Result:
        with redirect_stdout(sys.stderr):
            return call()

    def _asked(self, what: str, call: Callable[[], _Result]) -> _Result:
        try:
            return self._quietly(call)
        except Exception as error:
            raise RobotFault(f"{what} raised {last_line(error)}") from error

    def reset(self, seed: int) -> None:
        """Begins an episode.

        Raises:
            RobotFault: it raises, or does not return what it should.
        """
        found = self._asked("reset", lambda: self._env.reset(seed=seed % _SEEDS))
        if not isinstance(found, tuple) or len(found) != 2:
            raise RobotFault(f"reset returned {_counted(found)}, not (observation, info)")
        self._observation = found[0]

    def step(self, action: int) -> Step:
        """One step with an action of 0..|A|-1.

        Raises:
            RobotFault: it raises, does not return what it should, or its reward is no finite number.
        """
        space: Any = self._env.action_space
        given = space.dtype.type(space.start + action)
        found = self._asked("step", lambda: self._env.step(given))
        if not isinstance(found, tuple) or len(found) != 5:
            raise RobotFault(
                f"step returned {_counted(found)}, not (observation, reward, terminated, truncated, info)"
            )
        self._observation, reward, terminated, truncated, info = found
        return Step(_reward(reward), bool(terminated), bool(truncated), _success(info))

    def picture(self) -> Picture:
        """What is to be seen now: uint8[height, width] or [height, width, channels].

        Raises:
            RobotFault: rendering raises, or what comes is no picture.
        """
        try:
            if self._observed is not None:
                return self._observed.picture(self._observation)
            return rendered(self._asked("render", self._env.render))
        except PictureError as error:
            what = "render returned" if self.renders else "it shows"
            raise RobotFault(f"{what} {error}") from error

    def close(self) -> None:
        """Ends it; what it raises then is of no consequence."""
        try:
            self._quietly(self._env.close)
        except Exception as error:
            log.warning("%s: close raised %s", self._name, last_line(error))


def play_at_random(env: GymEnvironment, task_name: str, channels: int, steps: int = 20) -> None:
    """Tries an environment out, with random actions over as many episodes as it takes, and looks at its pictures.

    Raises:
        ConfigError: it raises, does not return what it should, or shows nothing; the message is one sentence.
    """
    random = np.random.default_rng(0)
    frames = []
    try:
        env.reset(0)
        frames.append(as_frame(env.picture(), channels))
        for step in range(1, steps + 1):
            played = env.step(int(random.integers(env.actions)))
            frames.append(as_frame(env.picture(), channels))
            if played.terminated or played.truncated:
                env.reset(step)
                frames.append(as_frame(env.picture(), channels))
    except RobotFault as error:
        raise ConfigError(f"{task_name} cannot be a task: {error}") from error
    blind = why_blind(frames)
    if blind is not None:
        raise ConfigError(
            f"{task_name} shows nothing to learn from: {blind} (looked at {len(frames)} of them)"
        )


def last_line(error: BaseException) -> str:
    """An exception as the last line of its traceback has it, shortened."""
    lines = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__
    return text if len(text) <= _MAX_REASON else f"{text[:_MAX_REASON]}..."


def _actions_of(space: Any, task_name: str) -> int:
    if not isinstance(space, Discrete):
        raise ConfigError(f"{task_name} has actions {space}: only discrete ones can be learned")
    if not 2 <= space.n <= MAX_ACTIONS:
        raise ConfigError(f"{task_name} has {space.n} actions, a policy has 2..{MAX_ACTIONS}")
    return int(space.n)


def _counted(found: Any) -> str:
    return f"{len(found)} values" if isinstance(found, tuple) else f"a {type(found).__name__}"


def _reward(found: Any) -> float:
    if not isinstance(found, int | float | np.number | np.bool_) and np.shape(found) != ():
        raise RobotFault(f"reward {found!r} is no number but of shape {list(np.shape(found))}")
    try:
        reward = float(found)
    except (TypeError, ValueError):
        raise RobotFault(f"reward {found!r} is no number") from None
    if not math.isfinite(reward):
        raise RobotFault(f"reward {reward}")
    return reward


def _success(info: Any) -> bool | None:
    """`info["is_success"]`, or `info["success"]`, where there is one."""
    if not isinstance(info, dict):
        return None
    told = info.get("is_success", info.get("success"))
    return None if told is None or np.shape(told) not in ((), (1,)) else bool(told)
