"""A Gymnasium environment of somebody else: what it says is checked where it says it."""

import logging
import math
import sys
from collections.abc import Callable, Collection
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium.spaces import Dict

from bpn_robot.robot import RobotFault
from bpn_robot_sim.action_choices import choices_of
from bpn_robot_sim.gym_making import last_line, make
from bpn_robot_sim.pictures import ObservedPictures, Picture, PictureError, cropped, rendered
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.gym import OFF, GymOptions
from bpn_shared.spec.joint_actions import parted

log = logging.getLogger(__name__)

_SEEDS = 2**31  # some environments take no larger ones

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

    Its pictures are its observations where these are images, else what it renders as `rgb_array`; or what the
    options say.

    Args:
        task_name: gym: and its id.
        options: how it is made and looked at.
        allowed: modules that may be imported for it.

    Attributes:
        dims: choices of each dimension of its actions.
        renders: whether the pictures are rendered.
        note: why they are, where it has observations that are nearly images; "" otherwise.

    Raises:
        ConfigError: it is not installed or cannot be made, or its actions or pictures are none that a policy
            here could have.
    """

    def __init__(
        self, task_name: str, options: GymOptions = OFF, allowed: Collection[str] = ()
    ) -> None:
        self._name, self._options, self._allowed = task_name, options, allowed
        self.renders, self.note = options.frames_from == "renders", ""
        self._env = self._make()
        self._observed: ObservedPictures | None = None
        try:
            self._choices = choices_of(self._env.action_space, task_name, options.action_bins)
            self.dims = self._choices.dims
            self._choose_pictures()
        except BaseException:
            self.close()
            raise

    def _choose_pictures(self) -> None:
        space, options = self._env.observation_space, self._options
        why = "frames_from = 'renders'"
        if not self.renders:
            try:
                self._observed = ObservedPictures(space, options.observation_key)
                return
            except PictureError as error:
                why = str(error)
            if options.frames_from == "observations" or options.observation_key:
                raise ConfigError(f"{self._name}: {why}")
        metadata = getattr(self._env, "metadata", None)
        modes = metadata.get("render_modes") if isinstance(metadata, dict) else None
        if "rgb_array" not in (modes or ()):
            raise ConfigError(
                f"{self._name}: {why}, and it does not render as rgb_array; there is nothing for the policy "
                "to see"
            )
        if self.renders:
            return  # as it was made to
        self.close()
        self.renders = True
        self._env = self._make()
        if isinstance(space, Dict) or len(space.shape or ()) > 1:  # there may be an image in it
            self.note = f"{self._name}: {why}; the policy sees what it renders"

    def _make(self) -> gymnasium.Env[Any, Any]:
        return self._quietly(
            lambda: make(self._name, self._options, self._allowed, render=self.renders)
        )

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
        """One step with an action, by its number.

        Raises:
            RobotFault: it raises, does not return what it should, or its reward is no finite number.
        """
        given = self._choices.action(parted(action, self.dims))
        found = self._asked("step", lambda: self._env.step(given))
        if not isinstance(found, tuple) or len(found) != 5:
            raise RobotFault(
                f"step returned {_counted(found)}, not (observation, reward, terminated, truncated, info)"
            )
        self._observation, reward, terminated, truncated, info = found
        return Step(_reward(reward), bool(terminated), bool(truncated), _success(info))

    def picture(self) -> Picture:
        """What is to be seen now, cropped: uint8[height, width] or [height, width, channels].

        Raises:
            RobotFault: rendering raises, or what comes is no picture.
        """
        try:
            if self._observed is not None:
                picture = self._observed.picture(self._observation)
            else:
                picture = rendered(self._asked("render", self._env.render))
        except PictureError as error:
            what = "render returned" if self.renders else "it shows"
            raise RobotFault(f"{what} {error}") from error
        return cropped(picture, self._options.crop_px)

    def close(self) -> None:
        """Ends it; what it raises then is of no consequence."""
        try:
            self._quietly(self._env.close)
        except Exception as error:
            log.warning("%s: close raised %s", self._name, last_line(error))


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
