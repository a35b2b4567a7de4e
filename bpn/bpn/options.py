"""Command-line options that are the run configuration's fields, so that neither can miss one."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt

from bpn_shared.spec.algorithms import algorithm_names
from bpn_shared.spec.config import OPTIONS, RunConfig
from bpn_shared.spec.gym import GYM_PREFIX, GymOptions
from bpn_shared.spec.installed import is_installed, offered, preset_of
from bpn_shared.spec.renamed import RENAMED, called_now

_RANGES = {Ge: "≥ {}", Gt: "> {}", Le: "≤ {}", Lt: "< {}"}


def add_run_options(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    """Adds one option for every field of `RunConfig` but the task.

    Args:
        arguments: of the command; if they name a task, help shows the defaults that it will have.
    """
    task = next((word for word in arguments if is_installed(word)), None)
    of_whom = f"of {task}" if task else "of each task: `bpn train TASK --help`"
    group = parser.add_argument_group(f"run configuration (defaults {of_whom})")
    of_gym = parser.add_argument_group("of gym: tasks alone (docs/tasks/gym.md)")
    defaults = defaults_of(task) if task else common_defaults()
    for name in OPTIONS:
        if name != "task":
            field = RunConfig.model_fields[name]
            # of a yes-or-no, the option alone is a yes
            alone: dict[str, Any] = (
                {"nargs": "?", "const": True} if field.annotation is bool else {}
            )
            (of_gym if name in GymOptions.model_fields else group).add_argument(
                f"--{_flag(name)}",
                dest=name,
                metavar="|".join(algorithm_names()) if name == "algorithm" else _metavar(field),
                help=_help(field, _default(name, defaults, task)),
                **alone,
            )
    for old in RENAMED:
        refuse_old_name(parser, old)


def refuse_old_name(parser: argparse.ArgumentParser, name: str) -> None:
    """Makes an option of before end the program with the name that it has today."""
    parser.add_argument(f"--{_flag(name)}", nargs="?", action=_Renamed, help=argparse.SUPPRESS)


class _Renamed(argparse.Action):
    """An option that has another name today."""

    def __call__(
        self, parser: argparse.ArgumentParser, _: Any, __: Any, option: Any = None
    ) -> None:
        old = self.dest
        why = str(called_now(old)).replace(RENAMED[old], f"--{_flag(RENAMED[old])}")
        parser.error(f"{option} {why}")


def _flag(name: str) -> str:
    return name.replace("_", "-")


def defaults_of(task: str) -> dict[str, Any]:
    """What a run of the task gets where nothing is given; |A| of a Gymnasium environment may not be known (0)."""
    unknown = not preset_of(task).get("actions")
    config = RunConfig.for_task(task, **{"actions": 2} if unknown else {})
    values = {name: getattr(config, name) for name in OPTIONS}
    return values | ({"actions": 0} if unknown else {})


def common_defaults() -> dict[str, Any]:
    """The defaults in which all installed tasks agree."""
    names = [f"{name}ANY" if name == GYM_PREFIX else name for name in offered().presets]
    first, *others = [defaults_of(name) for name in names if not name.endswith(":")] or [{}]
    return {
        name: value
        for name, value in first.items()
        if all(other[name] == value for other in others)
    }


def add_runs_dir(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--runs-dir", type=Path, default=Path("runs"), help="where run folders are (default runs)"
    )


def given_run_options(options: argparse.Namespace) -> dict[str, Any]:
    """The fields that the command line names, but the task."""
    return {
        name: value
        for name in OPTIONS
        if name != "task" and (value := getattr(options, name, None)) is not None
    }


def _metavar(field: Any) -> str:
    if get_origin(field.annotation) is Literal:
        return "|".join(get_args(field.annotation))
    return str(field.annotation.__name__).upper()


def _default(name: str, defaults: Mapping[str, Any], task: str | None) -> str:
    if name in ("actions", "action_dims") and not defaults.get("actions"):
        return "found out" if task else "by task"
    if name not in defaults:
        return "by task"
    value = "none" if defaults[name] == "" else defaults[name]
    return f"{value} for {task}" if task else str(value)


def _help(field: Any, default: str) -> str:
    ranges = [_RANGES[type(m)].format(_bound(m)) for m in field.metadata if type(m) in _RANGES]
    bounds = f" ({', '.join(ranges)})" if ranges else ""
    return f"{field.description}{bounds}; default {default}".replace("%", "%%")


def _bound(constraint: Any) -> Any:
    return next(getattr(constraint, slot) for slot in constraint.__slots__)  # Ge(1) has one: ge
