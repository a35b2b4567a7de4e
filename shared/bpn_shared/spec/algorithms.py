"""What an algorithm is to every service: data that travels by value, in configurations and over the bus.

Only whoever creates a run looks an algorithm up by its name; all others are told its specification, and find the
parts that they need, targets or action selection, by the names in it. The project's own are in `cvi_family`.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_shared import plugins
from bpn_shared.errors import InputError

log = logging.getLogger(__name__)

NetworkKind = Literal["binary", "float"]

MAX_NAME = 60
NAME_PATTERN = r"^[A-Za-z0-9][\w.-]*$"
"""Of algorithms, kernels, targets and selections: a plug-in's name."""
PluginName = Annotated[str, Field(pattern=NAME_PATTERN, max_length=MAX_NAME)]

EPSILON_GREEDY, SOFTMAX = "epsilon_greedy", "softmax"
"""The action selections that every edge has."""

KERNELS: dict[NetworkKind, tuple[str, ...]] = {
    "binary": ("native", "golden"),
    "float": ("onnx",),
}
"""Which of the project's own kernels run a network; the first is an edge's choice where nobody makes another."""
CIRCUITS = frozenset({"rtl", "fpga"})
"""Those of its own kernels that run the paper's network alone, of any C, N and |A|."""


class AlgorithmSpec(BaseModel):
    """One algorithm.

    Attributes:
        name: what a configuration calls it.
        title: what people read; the name where it is empty.
        network: binary is the paper's, which an FPGA evaluates; float has the same geometry in floating point.
        targets: the plug-in of the group bpn.targets that computes what P is fitted to; for the learner.
        selection: the plug-in of the group bpn.selections that draws the actions of data; for the edge.
        preset: of a run's configuration, what its runs begin with; it has precedence over the task's.
        fixed: of a run's configuration, what can be no other with this algorithm.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: PluginName
    title: Annotated[str, Field(max_length=100)] = ""
    network: NetworkKind = "binary"
    targets: PluginName
    selection: PluginName = SOFTMAX
    preset: dict[str, bool | int | float | str] = {}
    fixed: dict[str, bool | int | float | str] = {}

    def __hash__(self) -> int:
        return hash(self.name)  # a preset has none

    @property
    def explores(self) -> bool:
        """Whether data are collected with a share epsilon of random actions."""
        return self.selection == EPSILON_GREEDY


class NoOptions(BaseModel):
    """Of an algorithm that has none of its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True)
class Algorithm:
    """What an entry point of the group bpn.algorithms is: a specification, and the model of its own options.

    Attributes:
        options: a pydantic model with a default for every field, whose values are JSON; what the configuration's
            `algorithm_options` are checked by when a run is made.
    """

    spec: AlgorithmSpec
    options: type[BaseModel] = NoOptions

    def checked(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """All of its own options, those that are not given with their defaults.

        Raises:
            ValueError: one is unknown or outside its range; the message names it.
        """
        try:
            return self.options.model_validate(given).model_dump(mode="json")
        except ValidationError as error:
            first = error.errors()[0]
            name = ".".join(map(str, first["loc"])) or "they"
            unknown = first["type"] == "extra_forbidden"
            there = ", ".join(self.options.model_fields) or "none"
            raise ValueError(
                f"{name} = {first['input']!r}: "
                + (f"unknown; one of: {there}" if unknown else first["msg"])
            ) from error


def find_algorithm(name: str) -> Algorithm:
    """The installed algorithm of that name.

    Raises:
        UnknownPluginError: there is none.
        PluginError: it is broken.
    """
    plugin = plugins.find(plugins.ALGORITHMS, name)
    found = plugin.load()
    if not isinstance(found, Algorithm):
        raise plugin.broken(f"it is {type(found).__name__}, no Algorithm")
    if found.spec.name != name:
        raise plugin.broken(f"it calls itself {found.spec.name!r}")
    try:
        found.checked({})
    except ValueError as error:
        raise plugin.broken(f"its options have no default: {error}") from error
    return found


def algorithm_names() -> tuple[str, ...]:
    """Of all that are installed, sorted; imports none of them."""
    return plugins.names(plugins.ALGORITHMS)


def offered_algorithms() -> list[Algorithm]:
    """All that are installed and sound, by name."""
    found = []
    for name in algorithm_names():
        try:
            found.append(find_algorithm(name))
        except InputError as error:
            log.warning("%s", error)
    return found


def implied(name: object) -> dict[str, Any]:
    """Values of a run's configuration that follow from its algorithm; {} for an unknown one."""
    try:
        spec = find_algorithm(str(name)).spec
    except InputError:
        return {}
    return spec.preset | spec.fixed
