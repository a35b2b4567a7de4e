"""How a Gymnasium environment is made and looked at: the options that only `gym:` tasks have.

All of them are off by default, and all are plain numbers and texts, so that each is a command-line option, a field
of the start form and an axis of a sweep like every other value of a configuration.
"""

import json
import re
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from bpn_shared.spec.network import MAX_ACTIONS

GYM_PREFIX = "gym:"
"""Begins the names of tasks that are any Gymnasium environment, such as gym:CartPole-v1."""
MODULE = r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*"
"""Of the names of Python modules."""
GYM_NAME = rf"{GYM_PREFIX}({MODULE}:)?([A-Za-z0-9_.-]+/)?[A-Za-z0-9_.-]+"
"""Of the names of `gym:` tasks: the environment's id, with the module in front that registers it."""
WRAPPERS_MODULE = "gymnasium.wrappers"
"""Where a wrapper without a module is."""

_OURS = ("id", "render_mode")
"""Arguments of `gymnasium.make` that the task's name and `frames_from` decide."""

FramesFrom = Literal["auto", "observations", "renders"]


class Crop(NamedTuple):
    """A part of a picture, in its pixels from the left and from the top."""

    x: int
    y: int
    width: int
    height: int


def _arguments(text: str) -> str:
    try:
        found = json.loads(text or "{}", parse_constant=_no_number)
    except ValueError as error:
        raise ValueError(f"no JSON ({error}); such as '{{\"continuous\": false}}'") from error
    if not isinstance(found, dict):
        raise ValueError("must be a JSON object; such as '{\"continuous\": false}'")
    for name in _OURS:
        if name in found:
            raise ValueError(f"{name} is not among them: task and frames_from decide it")
    return json.dumps(found, sort_keys=True) if found else ""


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _wrappers(text: str) -> str:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if not re.fullmatch(rf"({MODULE}:)?[A-Za-z_]\w*", name):
            raise ValueError(
                f"{name!r} must be MODULE:CLASS, or a class of {WRAPPERS_MODULE}; several separated by commas"
            )
    return ",".join(names)


def _rectangle(text: str) -> str:
    plain = text.replace(" ", "")
    if plain and not re.fullmatch(r"\d{1,5},\d{1,5},0*[1-9]\d{0,4},0*[1-9]\d{0,4}", plain):
        raise ValueError("must be X,Y,WIDTH,HEIGHT in pixels of the picture, such as 0,34,160,160")
    return ",".join(str(int(number)) for number in plain.split(",")) if plain else ""


class GymOptions(BaseModel):
    """What is asked of a Gymnasium environment beside its id."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    env_kwargs: Annotated[
        str,
        AfterValidator(_arguments),
        Field(
            max_length=4000, description="gym tasks: keyword arguments of the environment, as JSON"
        ),
    ] = ""
    env_wrappers: Annotated[
        str,
        AfterValidator(_wrappers),
        Field(
            max_length=1000,
            description="gym tasks: wrappers, innermost first: MODULE:CLASS, or a class of "
            f"{WRAPPERS_MODULE}; separated by commas",
        ),
    ] = ""
    frames_from: Annotated[
        FramesFrom,
        Field(
            description="gym tasks: what the policy sees; auto: observations where they are pictures"
        ),
    ] = "auto"
    observation_key: Annotated[
        str,
        Field(max_length=100, description="gym tasks: which part of Dict observations is seen"),
    ] = ""
    crop: Annotated[
        str,
        AfterValidator(_rectangle),
        Field(
            max_length=50,
            description="gym tasks: part of the picture that is seen, X,Y,WIDTH,HEIGHT in its pixels",
        ),
    ] = ""
    max_over_frames: Annotated[
        int,
        Field(
            ge=1,
            le=100,
            description="gym tasks: a frame is the brightest of so many of the last skipped ones "
            "(2 for Atari, whose sprites flicker)",
        ),
    ] = 1
    difference: Annotated[
        bool,
        Field(
            description="gym tasks: in an observation, earlier frames are replaced by what changed since"
        ),
    ] = False
    action_bins: Annotated[
        int,
        Field(
            ge=0,
            le=MAX_ACTIONS,
            description="gym tasks: values that a continuous action is chosen from; 0: 3 where actions are "
            "continuous",
        ),
    ] = 0

    @property
    def arguments(self) -> dict[str, Any]:
        """The environment's keyword arguments."""
        found: dict[str, Any] = json.loads(self.env_kwargs or "{}")
        return found

    @property
    def wrappers(self) -> list[tuple[str, str]]:
        """Module and class of every wrapper, innermost first."""
        return _split(self.env_wrappers)

    @property
    def crop_px(self) -> Crop | None:
        return Crop(*map(int, self.crop.split(","))) if self.crop else None

    def alone(self) -> "GymOptions":
        """These options without what a class that has more adds to them."""
        return GymOptions(**{name: getattr(self, name) for name in GymOptions.model_fields})

    def check(self, *, frames_stacked: int, frame_skip: int) -> None:
        """Refuses options that do not fit together.

        Raises:
            ValueError: the message names them.
        """
        if self.difference and frames_stacked < 2:
            raise ValueError(
                f"difference = True with frames_stacked = {frames_stacked}: it takes the earlier frames' place, "
                "so an observation needs 2 or more"
            )
        if self.max_over_frames > frame_skip:
            raise ValueError(
                f"max_over_frames = {self.max_over_frames} with frame_skip = {frame_skip}: an action has no more "
                "frames than steps"
            )
        if self.observation_key and self.frames_from == "renders":
            raise ValueError(
                f"observation_key = {self.observation_key!r} with frames_from = 'renders': what is rendered has "
                "no keys; leave one out"
            )


def _split(wrappers: str) -> list[tuple[str, str]]:
    names = [name.strip().rpartition(":") for name in wrappers.split(",") if name.strip()]
    return [(module or WRAPPERS_MODULE, name) for module, _, name in names]


OFF = GymOptions()
"""None of them."""


def changed(options: GymOptions) -> list[str]:
    """Which of the options are not off."""
    return [
        name
        for name, field in GymOptions.model_fields.items()
        if getattr(options, name) != field.default
    ]


def id_of(task: str) -> tuple[str, str]:
    """Module ("" if none is named) and id of a `gym:` task's environment."""
    module, _, env_id = task.removeprefix(GYM_PREFIX).rpartition(":")
    return module, env_id


def modules_named(task: str, env_wrappers: str) -> list[str]:
    """The modules of somebody else that a `gym:` task and its wrappers name, in order."""
    named = [id_of(task)[0], *(module for module, _ in _split(env_wrappers))]
    return [module for module in dict.fromkeys(named) if module not in ("", WRAPPERS_MODULE)]
