"""What a task is to every service: data that travels by value, in configurations and over the bus.

Only whoever creates a run looks a task up by its name (`bpn_shared.spec.installed`); all others are told its
specification, and find the parts that they need, robot or rewards, by the names in it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from bpn_shared.spec.disturbances import Disturbances, parse, shown
from bpn_shared.spec.gym import GYM_PREFIX, OFF, GymOptions
from bpn_shared.spec.joint_actions import format_dims, parse_dims, parted
from bpn_shared.spec.network import (
    IMAGE_SIZE_PX,
    MAX_ACTION_DIMS,
    MAX_ACTIONS,
    MAX_CHANNELS,
    MAX_IMAGE_SIZE_PX,
    MIN_IMAGE_SIZE_PX,
    PAPER_CONVOLUTIONS,
    Convolution,
    NetworkSpec,
)

RETURN_PX, RETURN = "return_px", "return"
"""Mean return of an iteration: in pixels, or in another unit."""

MAX_NAME = 256
NAME_PATTERN = r"^[A-Za-z0-9_][A-Za-z0-9_.-]*(:[!-~]*)?$"
"""Of tasks: a plug-in's name, and of a family's tasks which of them."""


def is_gym(name: str) -> bool:
    """Whether the task is a Gymnasium environment outside of this project."""
    return name.startswith(GYM_PREFIX)


_PluginName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=100)]
_ActionName = Annotated[str, Field(min_length=1, max_length=100)]


class TaskOptions(GymOptions):
    """What a configuration may choose of a task of a family; 0: as the task has it."""

    frame_channels: Annotated[
        int, Field(ge=0, le=3, description="gym tasks: 1 gray, 3 RGB; 0: as the task has it")
    ] = 0
    frame_px: Annotated[
        int,
        Field(
            ge=0,
            le=MAX_IMAGE_SIZE_PX,
            description=f"gym tasks: rows and columns of a frame, {MIN_IMAGE_SIZE_PX} to {MAX_IMAGE_SIZE_PX}; "
            "0: as the task has it",
        ),
    ] = 0
    frames_stacked: Annotated[
        int,
        Field(
            ge=0, le=MAX_CHANNELS, description="gym tasks: frames in an observation; 0: as the task"
        ),
    ] = 0
    frame_skip: Annotated[
        int,
        Field(ge=0, le=100, description="gym tasks: steps that an action takes; 0: as the task"),
    ] = 0
    actions: Annotated[
        int, Field(ge=0, le=MAX_ACTIONS, description="gym tasks: |A|; 0: found out by `bpn train`")
    ] = 0
    action_dims: Annotated[
        str,
        AfterValidator(lambda text: format_dims(parse_dims(text))),
        Field(
            max_length=200,
            description="gym tasks: choices of each dimension of an action, 3,3 say; empty: one dimension, or "
            "found out by `bpn train`",
        ),
    ] = ""
    disturb: Annotated[
        str,
        AfterValidator(lambda text: shown(parse(text))),
        Field(
            max_length=500,
            description="disturbances of camera and servos: noise=25,offset=-30..30 (docs/disturbances.md)",
        ),
    ] = ""


FOR_EVERY_TASK = ("disturb",)
"""Of these options, what a configuration may choose of any task."""


class TaskSpec(BaseModel):
    """One task.

    Attributes:
        name: what a configuration calls it.
        title: what people read; the name where it is empty.
        robot: the plug-in of the group bpn.robots that plays it.
        rewards: the plug-in of the group bpn.rewards that computes them from pixels (the paper, section VI-A);
            None: the robot tells them.
        reward_unit: of rewards and returns.
        plot: the plug-in of the group bpn.plots that draws trajectories; None: there is none.
        frame_channels: c of one camera frame uint8[c, rows, columns].
        frame_px: rows and columns of a frame.
        frames_stacked: frames in one observation; C = frame_channels * frames_stacked.
        frame_skip: steps of a Gymnasium environment that one action takes.
        action_names: what each action does, with its unit; |A| of them. Of an action of several dimensions, what
            each choice does, the dimensions' side by side as a policy's outputs are.
        action_dims: how many of them each dimension has; none: there is one dimension (docs/factored-actions.md).
        hold_action: the action that leaves the robot where it is; what a robot did when no action
            came in time (realtime pacing). As all actions, a number of 0..joint_actions-1.
        control_period_s: time between two frames in realtime pacing.
        gym: how the environment of a gym: task is made and looked at.
        realtime: whether the robot has a clock of its own, so that realtime pacing is possible.
        success: when an episode has done what the task is about: its last step's reward is at least
            `success_reward`; it was not terminated; the robot tells; or nobody says.
        disturbances: of camera and servos, by kind; see `bpn_shared.spec.disturbances`.
        preset: of a run's configuration, what such runs begin with where it is not the fields' default.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=MAX_NAME)]
    title: Annotated[str, Field(max_length=100)] = ""
    robot: _PluginName
    rewards: _PluginName | None = None
    reward_unit: Literal["px", ""] = ""
    plot: _PluginName | None = None
    frame_channels: Annotated[int, Field(ge=1, le=3)]
    frame_px: Annotated[int, Field(ge=MIN_IMAGE_SIZE_PX, le=MAX_IMAGE_SIZE_PX)] = IMAGE_SIZE_PX
    frames_stacked: Annotated[int, Field(ge=1, le=MAX_CHANNELS)] = 1
    frame_skip: Annotated[int, Field(ge=1, le=100)] = 1
    action_names: Annotated[tuple[_ActionName, ...], Field(min_length=2, max_length=MAX_ACTIONS)]
    action_dims: Annotated[
        tuple[Annotated[int, Field(ge=2)], ...], Field(max_length=MAX_ACTION_DIMS)
    ] = ()
    hold_action: Annotated[int, Field(ge=0)] = 0
    control_period_s: Annotated[float, Field(gt=0, le=60)]
    gym: GymOptions = OFF
    realtime: bool = True
    success: Literal["last_reward", "not_terminated", "told", "undefined"] = "undefined"
    success_reward: Annotated[float, Field(allow_inf_nan=False)] | None = None
    disturbances: Disturbances = {}
    preset: dict[str, bool | int | float | str] = {}

    @field_validator("frame_channels")
    @classmethod
    def _gray_or_rgb(cls, channels: int) -> int:
        if channels == 2:
            raise ValueError("must be 1 (gray) or 3 (RGB)")
        return channels

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.frame_channels * self.frames_stacked > MAX_CHANNELS:
            raise ValueError(
                f"frames_stacked = {self.frames_stacked} of {self.frame_channels} channels: an observation has "
                f"at most {MAX_CHANNELS} channels"
            )
        if sum(self.dims) != self.actions or len(self.action_dims) == 1:
            raise ValueError(
                f"action_dims = {list(self.action_dims)}: they have to be several, and {self.actions} together, "
                "as many as action_names; leave them out where an action has one dimension"
            )
        if self.hold_action >= self.joint_actions:
            raise ValueError(
                f"hold_action = {self.hold_action}: there are the actions 0..{self.joint_actions - 1}"
            )
        if (self.success == "last_reward") != (self.success_reward is not None):
            raise ValueError("success_reward belongs to success = last_reward, and to no other")
        return self

    def __hash__(self) -> int:
        return hash(self.name)  # a preset has none

    @property
    def told_rewards(self) -> bool:
        """Whether the robot tells rewards; then it may also end episodes for reasons of its own."""
        return self.rewards is None

    @property
    def return_metric(self) -> str:
        """Name of the mean return in metrics: `return_px`, or `return` where the unit is another."""
        return RETURN_PX if self.reward_unit == "px" else RETURN

    @property
    def return_unit(self) -> str:
        """What to print behind a return: " px", or nothing."""
        return " px" if self.reward_unit == "px" else ""

    @property
    def actions(self) -> int:
        """Outputs of its policies: |A|, or the choices of all dimensions together."""
        return len(self.action_names)

    @property
    def dims(self) -> tuple[int, ...]:
        """Choices of each dimension of an action; of one dimension, |A|."""
        return self.action_dims or (self.actions,)

    @property
    def joint_actions(self) -> int:
        """How many actions there are; of one dimension, |A|."""
        return math.prod(self.dims)

    def choices(self, action: int) -> tuple[int, ...]:
        """An action's choice in each dimension, by its number (`joint_actions`).

        Raises:
            ValueError: there is no such action.
        """
        return parted(action, self.dims)

    def action_name(self, action: int) -> str:
        """What an action does.

        Raises:
            ValueError: there is no such action.
        """
        first, names = 0, []
        for choice, choices in zip(self.choices(action), self.dims, strict=True):
            names.append(self.action_names[first + choice])
            first += choices
        return ", ".join(names)

    @property
    def frame_shape(self) -> tuple[int, int, int]:
        return self.frame_channels, self.frame_px, self.frame_px

    def network(
        self, hidden_units: int, convolutions: tuple[Convolution, ...] = PAPER_CONVOLUTIONS
    ) -> NetworkSpec:
        """The geometry of this task's policy with N = hidden_units.

        Raises:
            ValueError: the convolutions do not fit its frames.
        """
        return NetworkSpec(
            self.frame_channels * self.frames_stacked, hidden_units, self.actions,
            convolutions=convolutions, image_px=self.frame_px, action_dims=self.dims,
        )  # fmt: skip

    def options(self) -> dict[str, Any]:
        """What `TaskOptions` say of this task."""
        values: dict[str, Any] = dict(self.gym) | {"disturb": shown(self.disturbances)}
        values["action_dims"] = format_dims(self.action_dims)
        own = (name for name in TaskOptions.model_fields if name not in values)
        return values | {name: getattr(self, name) for name in own}

    def disturbed(self, text: str) -> Self:
        """The same task with other disturbances, as `disturbances.parse` takes them.

        Raises:
            InputError: they are impossible.
        """
        return self.model_copy(update={"disturbances": parse(text)})


@dataclass(frozen=True, slots=True)
class TaskFamily:
    """Tasks without number that one plug-in makes, such as gym:CartPole-v1: its name, a colon, which of them.

    Attributes:
        which: what stands behind the colon, for help.
        title: of all of them, for people.
        make: the specification of the task of a whole name, with options.
        preset: of the task of a whole name, before it can be made; of the bare "FAMILY:", what others have.
        known: whole names of tasks with a preset of their own.
        noun: what one of them is called in a form.
        about: what there is to know for who types which of them.
        pattern: of what stands behind the colon, a regular expression in any program's words.
    """

    which: str
    title: str
    make: Callable[[str, TaskOptions], TaskSpec]
    preset: Callable[[str], Mapping[str, Any]]
    known: tuple[str, ...] = ()
    noun: str = "Which"
    about: str = ""
    pattern: str = "[!-~]+"
