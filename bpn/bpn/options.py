"""Command-line options that are the run configuration's fields, so that neither can miss one."""

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt

from bpn_shared.spec.config import PRESETS, RunConfig, preset_of
from bpn_shared.spec.tasks import GYM_PREFIX, TASK_PATTERN, TASKS, is_gym

_RANGES = {Ge: "≥ {}", Gt: "> {}", Le: "≤ {}", Lt: "< {}"}
_ANY_GYM = f"{GYM_PREFIX}ANY"


def add_run_options(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    """Adds one option for every field of `RunConfig` but the task.

    Args:
        arguments: of the command; if they name a task, help shows the defaults that it will have.
    """
    task = next((word for word in arguments if re.fullmatch(TASK_PATTERN, word)), None)
    of_whom = f"of {task}" if task else "of each task: `bpn train TASK --help`"
    group = parser.add_argument_group(f"run configuration (defaults {of_whom})")
    defaults = defaults_of(task) if task else common_defaults()
    for name, field in RunConfig.model_fields.items():
        if name != "task":
            # of a yes-or-no, the option alone is a yes
            alone: dict[str, Any] = (
                {"nargs": "?", "const": True} if field.annotation is bool else {}
            )
            group.add_argument(
                f"--{name.replace('_', '-')}",
                dest=name,
                metavar=_metavar(field),
                help=_help(field, _default(name, defaults, task)),
                **alone,
            )


def defaults_of(task: str) -> dict[str, Any]:
    """What a run of the task gets where nothing is given; |A| of a Gymnasium environment may not be known (0)."""
    unknown = is_gym(task) and not preset_of(task).get("actions")
    config = RunConfig.for_task(task, **{"actions": 2} if unknown else {})
    return dict(config) | ({"actions": 0} if unknown else {})


def common_defaults() -> dict[str, Any]:
    """The defaults in which all tasks agree."""
    first, *others = (defaults_of(task) for task in {**TASKS, **PRESETS, _ANY_GYM: None})
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
        for name in RunConfig.model_fields
        if name != "task" and (value := getattr(options, name, None)) is not None
    }


def _metavar(field: Any) -> str:
    if get_origin(field.annotation) is Literal:
        return "|".join(get_args(field.annotation))
    return str(field.annotation.__name__).upper()


def _default(name: str, defaults: Mapping[str, Any], task: str | None) -> str:
    if name == "actions" and not defaults.get(name):
        return "found out" if task else "by task"
    if name not in defaults:
        return "by task"
    return f"{defaults[name]} for {task}" if task else str(defaults[name])


def _help(field: Any, default: str) -> str:
    ranges = [_RANGES[type(m)].format(_bound(m)) for m in field.metadata if type(m) in _RANGES]
    bounds = f" ({', '.join(ranges)})" if ranges else ""
    return f"{field.description}{bounds}; default {default}".replace("%", "%%")


def _bound(constraint: Any) -> Any:
    return next(getattr(constraint, slot) for slot in constraint.__slots__)  # Ge(1) has one: ge
