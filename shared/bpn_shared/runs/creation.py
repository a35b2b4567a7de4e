"""What a new run may be: the one way from what somebody asks for to a configuration, whichever door they come by.

Command line (with and without a dashboard), REST, web form and sweeps all call `configure`, and a resumed run
passes `Workplace.check` again. So all know the same tasks and presets, find out the same things, and refuse the
same values in the same words, before anything is written or started.
"""

from collections.abc import Mapping
from typing import Any, Literal, Protocol

from bpn_shared.messages.probe import ProbeReply, ProbeRequest
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.installed import preset_of
from bpn_shared.spec.joint_actions import format_dims
from bpn_shared.spec.tasks import is_gym

_ANY_ACTIONS = 2
"""|A| that stands in for one that is not known yet, while the other values are checked."""


class Workplace(Protocol):
    """The machines that will do a run, as far as whoever creates it knows them."""

    def probe(self, asked: ProbeRequest) -> ProbeReply | None:
        """Tries a Gymnasium environment out; None if nobody is there who could.

        Raises:
            ConfigError: it cannot be a task, or what it needs is not installed.
        """
        ...

    def check(self, config: RunConfig) -> None:
        """Refuses what these machines cannot do; what is not known of them is no reason.

        Raises:
            ConfigError: something that the run needs is missing; the message names value and remedy.
        """
        ...


def configure(values: Mapping[str, Any], place: Workplace) -> RunConfig:
    """The configuration that a new run gets.

    The actions of a Gymnasium environment, and where its frames come from, are found out here, once, so that no
    other service needs it; where the actions are given, no environment is opened.

    Args:
        values: the task, and what is changed from its preset; texts are read as numbers where numbers belong.
        place: where the run will be done.

    Raises:
        ConfigError: a value is wrong, or the workplace cannot do it.
    """
    config = _checked(values)
    if _lacks_actions(values):
        config = _checked({**values, **_found_out(config, place)})
    place.check(config)
    return config


def request_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values as a registry takes them: checked, with their types, and with nothing that was not given.

    Raises:
        ConfigError: a value is wrong.
    """
    config = _checked(values)
    left_open = {"actions"} if _lacks_actions(values) else set()
    return {name: getattr(config, name) for name in values if name not in left_open}


def _found_out(config: RunConfig, place: Workplace) -> dict[str, Any]:
    """|A| of a Gymnasium environment, and where its frames come from."""
    channels: Literal[1, 3] = 3 if config.frame_channels == 3 else 1
    options = dict(config.alone())
    found = place.probe(ProbeRequest(task=config.task, frame_channels=channels, **options))
    if found is not None:
        dims = format_dims(found.dims if len(found.dims) > 1 else ())
        return {"actions": found.actions, "action_dims": dims, "frames_from": found.seen}
    actions = preset_of(config.task).get("actions")
    if actions is None:
        raise ConfigError(
            f"task = {config.task!r}: no robot worker is connected that could open the environment and count its "
            "actions; start one (`bpn up`, or bpn-robot-sim on any machine), or give actions"
        )
    return {"actions": int(actions)}


def _checked(values: Mapping[str, Any]) -> RunConfig:
    """What is wrong in itself is said before an environment is opened for the rest."""
    changes = dict(values)
    task = changes.pop("task", None)
    if not isinstance(task, str):
        raise ConfigError("task: missing" if task is None else f"task = {task!r}: must be a name")
    if _lacks_actions(values):
        changes["actions"] = _ANY_ACTIONS
    return RunConfig.for_task(task, **changes)


def _lacks_actions(values: Mapping[str, Any]) -> bool:
    given = values.get("actions") not in (None, 0, "0") or values.get("action_dims")
    return is_gym(str(values.get("task", ""))) and not given
