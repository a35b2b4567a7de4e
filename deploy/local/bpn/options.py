"""Command-line options that are the run configuration's fields, so that neither can miss one."""

import argparse
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt

from bpn_robot_sim.probe import probe_in_child
from bpn_shared.config import RunConfig
from bpn_shared.messages.probe import ProbeRequest
from bpn_shared.tasks import is_gym

_RANGES = {Ge: "≥ {}", Gt: "> {}", Le: "≤ {}", Lt: "< {}"}


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Adds one option for every field of `RunConfig` but the task."""
    group = parser.add_argument_group("run configuration (defaults: the task's preset)")
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
                help=_help(field),
                **alone,
            )


def add_runs_dir(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--runs-dir", type=Path, default=Path("runs"), help="where run folders are (default runs)"
    )


def config_from(options: argparse.Namespace) -> RunConfig:
    """The configuration that the options ask for.

    The actions of a Gymnasium environment are found out here, once, so that no other service needs it.

    Raises:
        ConfigError: a value is outside its range, named with its option, or the environment cannot be a task.
    """
    given = given_run_options(options)
    if is_gym(options.task):
        given = {"actions": probe_in_child(ProbeRequest(task=options.task)).actions} | given
    return RunConfig.for_task(options.task, **given)


def given_run_options(options: argparse.Namespace) -> dict[str, Any]:
    """The fields that the command line names."""
    return {
        name: value
        for name in RunConfig.model_fields
        if name != "task" and (value := getattr(options, name, None)) is not None
    }


def _metavar(field: Any) -> str:
    if get_origin(field.annotation) is Literal:
        return "|".join(get_args(field.annotation))
    return str(field.annotation.__name__).upper()


def _help(field: Any) -> str:
    ranges = [_RANGES[type(m)].format(_bound(m)) for m in field.metadata if type(m) in _RANGES]
    bounds = f" ({', '.join(ranges)})" if ranges else ""
    return f"{field.description}{bounds}; default {field.default}".replace("%", "%%")


def _bound(constraint: Any) -> Any:
    return next(getattr(constraint, slot) for slot in constraint.__slots__)  # Ge(1) has one: ge
