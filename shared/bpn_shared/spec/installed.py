"""The tasks that are installed here, for whoever creates a run: plug-ins of the group bpn.tasks."""

import logging
from dataclasses import dataclass
from typing import Any

from bpn_shared import plugins
from bpn_shared.errors import InputError
from bpn_shared.plugins import Plugin, UnknownPluginError
from bpn_shared.spec.gym import GYM_PREFIX
from bpn_shared.spec.tasks import TaskFamily, TaskOptions, TaskSpec

log = logging.getLogger(__name__)


class UnknownTaskError(InputError):
    """No installed plug-in has the task."""


@dataclass(frozen=True, slots=True)
class OfferedTasks:
    """What can be chosen.

    Attributes:
        specs: of the tasks that are one.
        families: by name, the others.
        presets: by whole name of a task; "FAMILY:" has that of a family's tasks without their own.
    """

    specs: tuple[TaskSpec, ...]
    families: dict[str, TaskFamily]
    presets: dict[str, dict[str, Any]]


def task_names() -> str:
    """For help and errors: the names that tasks may have here; imports nothing."""
    names = (
        f"{GYM_PREFIX}[MODULE:]ENVIRONMENT-ID" if f"{name}:" == GYM_PREFIX else name
        for name in plugins.names(plugins.TASKS)
    )
    return ", ".join(names) or "none is installed"


def is_installed(name: str) -> bool:
    """Whether there is a plug-in for a task of that name; does not import it."""
    return name.partition(":")[0] in plugins.names(plugins.TASKS)


def task_spec(name: str, options: TaskOptions) -> TaskSpec:
    """The specification of the task of that name.

    Args:
        options: for a task of a family; of another all of the specification but its disturbances is its own.

    Raises:
        UnknownTaskError: there is none here.
        InputError: an option is impossible, or the plug-in is broken.
    """
    plugin, task = _find(name)
    spec = plugin.apply(task.make, name, options) if isinstance(task, TaskFamily) else task
    _check_name(plugin, spec, name)
    given = "disturb" in options.model_fields_set  # none too, of a task that has some
    return spec.disturbed(options.disturb) if given else spec


def preset_of(name: str) -> dict[str, Any]:
    """Values that a task's runs begin with where they differ from the fields' defaults.

    Raises:
        UnknownTaskError: there is none here.
        PluginError: the plug-in is broken.
    """
    plugin, task = _find(name)
    if isinstance(task, TaskFamily):
        preset: dict[str, Any] = plugin.apply(lambda: dict(task.preset(name)))
        return preset
    return task.options() | task.preset


def offered() -> OfferedTasks:
    """All that are installed; a broken one is left out and said in the log."""
    specs: list[TaskSpec] = []
    families: dict[str, TaskFamily] = {}
    presets: dict[str, dict[str, Any]] = {}
    for name in plugins.names(plugins.TASKS):
        try:
            task = _loaded(plugins.find(plugins.TASKS, name))
            wholes = (*task.known, f"{name}:") if isinstance(task, TaskFamily) else (name,)
            presets |= {whole: preset_of(whole) for whole in wholes}
        except InputError as error:
            log.warning("%s", error)
            continue
        if isinstance(task, TaskFamily):
            families[name] = task
        else:
            specs.append(task)
    return OfferedTasks(tuple(specs), families, presets)


def _find(name: str) -> tuple[Plugin, TaskSpec | TaskFamily]:
    head, colon, _which = name.partition(":")
    try:
        plugin = plugins.find(plugins.TASKS, head)
    except UnknownPluginError as error:
        raise UnknownTaskError(f"task = {name!r}: unknown; one of: {task_names()}") from error
    task = _loaded(plugin)
    if isinstance(task, TaskFamily) != bool(colon):
        wanted = f"{head}:{task.which}" if isinstance(task, TaskFamily) else head
        raise UnknownTaskError(f"task = {name!r}: unknown; {wanted} is what {head} has")
    return plugin, task


def _loaded(plugin: Plugin) -> TaskSpec | TaskFamily:
    loaded = plugin.load()
    task = loaded if isinstance(loaded, TaskFamily) else plugin.apply(loaded)
    if not isinstance(task, TaskSpec | TaskFamily):
        raise plugin.broken(f"it is {type(task).__name__}, no TaskSpec")
    if isinstance(task, TaskSpec):
        _check_name(plugin, task, plugin.name)
    return task


def _check_name(plugin: Plugin, spec: object, name: str) -> None:
    if not isinstance(spec, TaskSpec) or spec.name != name:
        raise plugin.broken(f"what it has for {name!r} is no TaskSpec of that name")
