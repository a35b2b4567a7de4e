"""What other packages add: entry points of named groups, looked up among those installed and loaded when used.

A name never becomes an import by itself: it is looked up among the entry points of installed distributions, so
that a configuration from elsewhere loads nothing that whoever set up the machine did not install. The project's
own parts are entry points of its packages as well; there is no second path.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from bpn_shared.errors import InputError, one_line


@dataclass(frozen=True, slots=True)
class Group:
    """One entry-point group.

    Attributes:
        name: in packaging files, such as bpn.tasks.
        noun: what one of them is called in messages.
    """

    name: str
    noun: str


TASKS = Group("bpn.tasks", "task")
"""Functions that return a task's specification; for whoever creates a run."""
ALGORITHMS = Group("bpn.algorithms", "algorithm")
"""What an algorithm is; for whoever creates a run."""
TARGETS = Group("bpn.targets", "targets")
"""What P is fitted to; for the learner."""
SELECTIONS = Group("bpn.selections", "action selection")
"""How actions are drawn from a policy's outputs; for the edge."""
ROBOTS = Group("bpn.robots", "robot")
"""Factories of robots; for the robot service."""
REWARDS = Group("bpn.rewards", "rewards")
"""Functions that compute rewards from frames; for whoever learns from them or judges them."""
CALLBACKS = Group("bpn.callbacks", "callback")
"""What is done during training beside it; for the learner."""
KERNELS = Group("bpn.kernels", "kernel")
"""What runs policies; for the edge."""

PLOTS = Group("bpn.plots", "plot")
"""How episodes of a task are drawn; for `bpn eval --plot`."""


class PluginError(InputError):
    """A plug-in is missing, doubtful or broken; the message names it, its distribution and the remedy."""


class UnknownPluginError(PluginError):
    """None of that name is installed."""


@dataclass(frozen=True, slots=True)
class Plugin:
    """One installed entry point; nothing of it is imported until `load`."""

    group: Group
    entry_point: EntryPoint

    @property
    def name(self) -> str:
        return self.entry_point.name

    @property
    def distribution(self) -> str:
        """Name and version of the package that has it, such as `bpn-robot-sim 0.1.0`."""
        return _distribution(self.entry_point)

    def load(self) -> Any:
        """The object that the entry point names.

        Raises:
            PluginError: it cannot be imported.
        """
        return self.apply(self.entry_point.load)

    def call(self, *args: Any, **kwargs: Any) -> Any:
        """What the entry point's function returns.

        Raises:
            PluginError: it cannot be imported, or raises anything but an `InputError`, which says enough.
        """
        return self.apply(self.load(), *args, **kwargs)

    def apply(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """What a function of the plug-in returns.

        Raises:
            PluginError: it raises anything but an `InputError`, which says enough.
        """
        try:
            return function(*args, **kwargs)
        except InputError:
            raise
        except (Exception, SystemExit) as error:  # the latter of a script that is imported
            raise self.broken(error) from error

    def broken(self, error: BaseException | str) -> PluginError:
        """The error that says what is wrong with it, and what to do."""
        said = error if isinstance(error, str) else one_line(error)
        package = self.distribution.split(" ")[0]
        return PluginError(
            f"{self.group.noun} {self.name!r} ({self.entry_point.value} of {self.distribution}) is broken: "
            f"{said}; mend or upgrade {package}, install what it needs, or remove it: pip uninstall {package}"
        )


def names(group: Group) -> tuple[str, ...]:
    """Of all that are installed, sorted; imports none of them."""
    return tuple(sorted({entry_point.name for entry_point in entry_points(group=group.name)}))


def find(group: Group, name: str) -> Plugin:
    """The installed plug-in of that name; does not import it.

    Raises:
        UnknownPluginError: there is none.
        PluginError: two distributions have one of that name.
    """
    found = tuple(entry_points(group=group.name, name=name))
    if not found:
        raise UnknownPluginError(
            f"{group.noun} {name!r} is not installed here; there are: {', '.join(names(group)) or 'none'}. "
            f"Install the package that has it (an entry point of the group {group.name})"
        )
    if len(found) > 1:
        raise PluginError(
            f"{group.noun} {name!r} is in {_all(found)}, and which is meant cannot be known; remove all but one "
            "with `pip uninstall`"
        )
    return Plugin(group, found[0])


def load(group: Group, name: str) -> Any:
    """The object of the installed plug-in of that name.

    Raises:
        UnknownPluginError: there is none.
        PluginError: two distributions have one of that name, or it cannot be imported.
    """
    return find(group, name).load()


def _distribution(entry_point: EntryPoint) -> str:
    dist = entry_point.dist
    return "an unnamed distribution" if dist is None else f"{dist.name} {dist.version}"


def _all(found: Iterable[EntryPoint]) -> str:
    return " and ".join(sorted(_distribution(entry_point) for entry_point in found))
