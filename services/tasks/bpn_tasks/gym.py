"""Gymnasium's environments as tasks: gym:CartPole-v1 and whatever else is installed where the robots are."""

import re
from typing import Any

from bpn_shared.errors import InputError
from bpn_shared.spec.gym import GYM_NAME, GYM_PREFIX
from bpn_shared.spec.joint_actions import parse_dims
from bpn_shared.spec.network import (
    IMAGE_SIZE_PX,
    MAX_ACTIONS,
    MAX_CHANNELS,
    MAX_IMAGE_SIZE_PX,
    MIN_IMAGE_SIZE_PX,
)
from bpn_shared.spec.tasks import TaskFamily, TaskOptions, TaskSpec
from bpn_tasks.specs import CONTROL_PERIOD_S

_PICTURES: dict[str, Any] = {
    # Gray frames in pairs, which show motion.
    "frame_channels": 1,
    "frames_stacked": 2,
    "frame_skip": 1,
    # Of whatever unit rewards are, and episodes end for good or bad: the usual treatment of terminals.
    "bootstrap_terminals": False,
    "steps": 200,
}

_RECIPE: dict[str, Any] = {
    # For tasks that nobody tuned: docs/tasks/gym.md says why each of them.
    "hidden_units": 256,
    "relative_targets": True,
    "n_step": 8,
    "episodes": 20,
    "replay_transitions": 20_000,
    "max_updates": 500,
    "reward_scale": 0.0,  # found out: rewards are of whatever unit
    "scale_initial": 0.0,
}

_PRESETS: dict[str, dict[str, Any]] = {
    # Three of its steps at once, because one moves the pole by less than a pixel; docs/tasks/gym.md.
    "gym:CartPole-v1": {
        "actions": 2,
        "frame_skip": 3,
        "hidden_units": 256,
        "alpha": 0.9,
        "gamma": 0.9,
        "iterations": 30,
        "episodes": 60,
        "steps": 100,
        "epochs": 10,
        "replay_iterations": 6,
        "learning_rate": 3e-3,
        "lr_run_final_factor": 0.1,
        "scale_initial": 0.05,
        "reward_scale": 0.6,
        "relative_targets": True,
    },
}


def preset(name: str) -> dict[str, Any]:
    """What runs of an environment begin with; of "gym:", those of environments without a preset of their own."""
    return _PICTURES | _PRESETS.get(name, _RECIPE)


def spec(name: str, options: TaskOptions) -> TaskSpec:
    """The Gymnasium environment of that name as a task.

    Raises:
        InputError: the name is none of an environment, or an option is impossible or still missing (0).
    """
    if not re.fullmatch(GYM_NAME, name):
        raise InputError(f"task = {name!r}: must be {GYM_PREFIX}[MODULE:]ENVIRONMENT-ID")
    channels = options.frame_channels or 1
    stacked = options.frames_stacked or 2
    size = options.frame_px or IMAGE_SIZE_PX
    dims = parse_dims(options.action_dims)
    actions = options.actions or sum(dims)
    if actions < 2:
        raise InputError(
            f"actions = {actions}: give the number of actions of {name!r} (`bpn train` finds it out)"
        )
    if dims and sum(dims) != actions:
        raise InputError(
            f"action_dims = {options.action_dims!r} are {sum(dims)} choices together, actions = {actions}: leave "
            "actions out"
        )
    if actions > MAX_ACTIONS:
        raise InputError(
            f"action_dims = {options.action_dims!r} are {actions} choices together, a policy has at most "
            f"{MAX_ACTIONS}"
        )
    if channels == 2:
        raise InputError("frame_channels = 2 must be 1 (gray) or 3 (RGB)")
    if size < MIN_IMAGE_SIZE_PX:
        raise InputError(f"frame_px = {size} is outside {MIN_IMAGE_SIZE_PX}..{MAX_IMAGE_SIZE_PX}")
    if channels * stacked > MAX_CHANNELS:
        raise InputError(
            f"frames_stacked = {stacked} of {channels} channels: an observation has at most "
            f"{MAX_CHANNELS} channels"
        )
    gym = options.alone()
    skip = options.frame_skip or 1
    try:
        gym.check(frames_stacked=stacked, frame_skip=skip)
    except ValueError as error:
        raise InputError(str(error)) from error
    return TaskSpec(
        name=name,
        title=name.removeprefix(GYM_PREFIX)[:100],
        robot="gym",
        frame_channels=channels,
        frame_px=size,
        frames_stacked=stacked,
        frame_skip=skip,
        gym=gym,
        action_names=_names(dims or (actions,)),
        action_dims=dims,
        control_period_s=CONTROL_PERIOD_S,  # without a meaning, as the hold action: it has no realtime pacing
        realtime=False,
        success="told",
        preset=preset(name),
    )


def _names(dims: tuple[int, ...]) -> tuple[str, ...]:
    if len(dims) == 1:
        return tuple(f"action {number}" for number in range(dims[0]))
    return tuple(f"action {d}: {choice}" for d, n in enumerate(dims) for choice in range(n))


GYM = TaskFamily(
    which="[MODULE:]ENVIRONMENT-ID",
    title="Gymnasium",
    noun="Environment",
    about="its id, behind MODULE: where a package registers it that robot workers allow; one of them opens it to "
    "count its actions, unless they are given below",
    pattern=GYM_NAME.removeprefix(GYM_PREFIX),
    make=spec,
    preset=preset,
    known=tuple(_PRESETS),
)
