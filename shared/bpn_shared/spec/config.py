"""The configuration of a run: its task and its algorithm by value, and the values of all sections, flat."""

import json
from contextlib import suppress
from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from bpn_shared.errors import InputError
from bpn_shared.spec import tasks
from bpn_shared.spec.algorithms import (
    CIRCUITS,
    KERNELS,
    MAX_NAME,
    NAME_PATTERN,
    AlgorithmSpec,
    find_algorithm,
    implied,
)
from bpn_shared.spec.disturbances import of_scope
from bpn_shared.spec.gym import GymOptions
from bpn_shared.spec.installed import preset_of, task_spec
from bpn_shared.spec.network import (
    IMAGE_SIZE_PX,
    PAPER_CONVOLUTIONS,
    NetworkSpec,
    parse_convolutions,
)
from bpn_shared.spec.renamed import called_now
from bpn_shared.spec.sections import AlgorithmValues, ExecutionValues, TrainingValues
from bpn_shared.spec.stopping import StopRule
from bpn_shared.spec.tasks import TaskOptions, TaskSpec, is_gym

_AS_THE_TASK = (
    "frame_channels", "frame_px", "frames_stacked", "frame_skip", "actions", "action_dims",
)  # fmt: skip
"""Options whose 0, or nothing, is whatever the task has."""
_OWN_KERNELS = CIRCUITS.union(*KERNELS.values())
"""Of the others, only the edge that has them can say what they run."""


_SILENT_PERIODS = 5


class ConfigError(InputError):
    """A configuration value is wrong; the message names the value, its range and where it came from."""


class RunConfig(ExecutionValues, TrainingValues, AlgorithmValues, TaskOptions):
    """One training. Field names are the command line's options; symbols are the paper's.

    Whoever creates a run makes it by the task's name, with `for_task`; everybody else reads it, and knows the task
    from `task_spec`, and the algorithm from `algorithm_spec`, alone. config.json has the values in their sections.
    """

    task: Annotated[
        str,
        Field(
            pattern=tasks.NAME_PATTERN,
            max_length=tasks.MAX_NAME,
            description="what the robot learns",
        ),
    ]
    task_spec: Annotated[TaskSpec, Field(description="the task itself, as it is named")]
    algorithm: Annotated[
        str,
        Field(
            pattern=NAME_PATTERN,
            max_length=MAX_NAME,
            description="binary network: bpn (CVI), bqn (DQN); float network: cvi, dqn, dpp (CVI, alpha = 1); or "
            "your own",
        ),
    ] = "bpn"
    algorithm_spec: Annotated[AlgorithmSpec, Field(description="the algorithm, as it is named")]

    @model_validator(mode="before")
    @classmethod
    def _fill_implied(cls, values: Any) -> Any:
        """What task and algorithm imply stands in for what was not given."""
        if not isinstance(values, dict):
            return values
        given = {
            name: v
            for name, v in values.items()
            if not (name in _AS_THE_TASK and v in (0, "0", ""))
        }
        of_task = values.get("task_spec")
        if isinstance(of_task, dict):
            with suppress(ValidationError):  # which is said of the field
                of_task = TaskSpec.model_validate(of_task)
        if isinstance(of_task, TaskSpec):
            given = of_task.options() | given
        name = given.setdefault("algorithm", "bpn")
        if "algorithm_spec" not in given:
            given["algorithm_spec"] = _algorithm_spec(name)
        return implied(name) | given

    @model_validator(mode="after")
    def _fits_task(self) -> Self:
        spec = self.task_spec
        if spec.name != self.task:
            raise ValueError(f"task = {self.task!r}: its task_spec is that of {spec.name!r}")
        if self.pacing == "realtime" and not spec.realtime:
            raise ValueError(
                f"pacing = 'realtime': {self.task!r} has no clock of its own; choose lockstep"
            )
        for name, value in spec.options().items():
            given = getattr(self, name)
            if given == value:
                continue
            if name in GymOptions.model_fields and not is_gym(self.task):
                raise ValueError(
                    f"{name} = {given!r}: task {self.task!r} is no Gymnasium environment; leave it out"
                )
            raise ValueError(f"{name} = {given}: task {self.task!r} has {value}; leave it out")
        return self

    @model_validator(mode="after")
    def _fits_algorithm(self) -> Self:
        spec = self.algorithm_spec
        if spec.name != self.algorithm:
            raise ValueError(
                f"algorithm = {self.algorithm!r}: its algorithm_spec is that of {spec.name!r}"
            )
        kernels = (*KERNELS[spec.network], *(sorted(CIRCUITS) if spec.network == "binary" else ()))
        if self.kernel in _OWN_KERNELS and self.kernel not in kernels:
            raise ValueError(
                f"kernel = {self.kernel!r} does not run the network of {self.algorithm!r}, which is "
                f"{spec.network}; one of: {', '.join(kernels)}"
            )
        for name, value in spec.fixed.items():
            if (given := getattr(self, name, None)) != value:
                raise ValueError(
                    f"{name} = {given}: algorithm {self.algorithm!r} has {name} = {value:g}; leave {name} out, or "
                    "choose another algorithm"
                )
        return self

    @model_validator(mode="after")
    def _possible_network(self) -> Self:
        try:
            network = self.network
        except ValueError as error:
            size = self.task_spec.frame_px
            raise ValueError(
                f"conv = {self.conv!r} with frames of {size} x {size}: {error}"
            ) from error
        if self.kernel in CIRCUITS and (
            network.convolutions != PAPER_CONVOLUTIONS or network.image_px != IMAGE_SIZE_PX
        ):
            raise ValueError(
                f"kernel = {self.kernel!r} is a circuit of the paper's convolutions over {IMAGE_SIZE_PX} px, this "
                f"run has conv = {self.conv!r} over {network.image_px} px: choose another kernel, or leave it out"
            )
        return self

    @model_validator(mode="after")
    def _parts_for_all_learners(self) -> Self:
        if self.learners > self.batch_size:
            raise ValueError(
                f"learners = {self.learners} with batch_size = {self.batch_size}: a minibatch is shared by all of "
                "them, so it needs at least as many transitions"
            )
        return self

    @model_validator(mode="after")
    def _possible_stop(self) -> Self:
        if self.stop_when:
            rule = StopRule.parse(self.stop_when)
            if not self.callbacks:  # which may add any
                rule.check(self.task_spec.return_metric, evaluated=bool(self.evaluate_every))
        return self

    @model_validator(mode="after")
    def _delay_needs_time(self) -> Self:
        if self.action_delay_ms and self.pacing == "lockstep":
            raise ValueError(
                f"action_delay_ms = {self.action_delay_ms} means nothing in lockstep, where the robot "
                "waits for the action: set pacing = realtime"
            )
        return self

    @model_validator(mode="after")
    def _latency_needs_time(self) -> Self:
        if of_scope(self.task_spec.disturbances, "time") and self.pacing == "lockstep":
            raise ValueError(
                f"disturb = {self.disturb!r}: latency means nothing in lockstep, where the robot waits for the "
                "action: set pacing = realtime, or leave it out"
            )
        return self

    @model_validator(mode="after")
    def _backlash_needs_servos(self) -> Self:
        if of_scope(self.task_spec.disturbances, "servo") and is_gym(self.task):
            raise ValueError(
                f"disturb = {self.disturb!r}: a Gymnasium environment has no servos with backlash; leave it out"
            )
        return self

    @property
    def network(self) -> NetworkSpec:
        return self.task_spec.network(self.hidden_units, parse_convolutions(self.conv))

    @property
    def policy(self) -> str:
        """What draws the actions of data, a plug-in of bpn.selections: CVI's policy is its softmax."""
        return self.algorithm_spec.selection

    @property
    def longest_silence_s(self) -> float:
        """How long robot and edge may hear nothing of each other: then the robot is stopped, or asked again."""
        realtime = self.pacing == "realtime"
        return max(1.0, _SILENT_PERIODS * self.task_spec.control_period_s if realtime else 0.0)

    @property
    def callback_names(self) -> tuple[str, ...]:
        """The callbacks of the training, in the order in which they are called; each once."""
        names = [
            *(["evaluation", "best"] if self.evaluate_every else []),
            *filter(None, self.callbacks.split(",")),
            *(["early_stop"] if self.stop_when else []),
            *(["tensorboard"] if self.tensorboard else []),
        ]
        return tuple(dict.fromkeys(names))

    def epsilon(self, iteration: int) -> float:
        """Share of uniformly random actions in an iteration: 0 where the policy is stochastic itself, as CVI's.

        For DQN it falls linearly from `epsilon_initial` to `epsilon_final` over the first half of the run.
        """
        if not self.algorithm_spec.explores:
            return 0.0
        progress = min(1.0, 2 * iteration / self.iterations)
        return self.epsilon_initial + progress * (self.epsilon_final - self.epsilon_initial)

    def beta_of(self, version: int) -> float:
        """The inverse temperature with which a weights version plays, and the update that follows it computes.

        From `beta` it rises linearly to `beta_run_final_factor` times that in the last iteration.
        """
        last = self.iterations - 1
        progress = min(version, last) / max(1, last)
        return self.beta * (1 + progress * (self.beta_run_final_factor - 1))

    def learning_rate_share(self, iteration: int) -> float:
        """Of the learning rate, in an iteration: from 1 linearly to `lr_run_final_factor`."""
        progress = iteration / max(1, self.iterations - 1)
        return 1 + progress * (self.lr_run_final_factor - 1)

    def disturbed(self, text: str) -> Self:
        """The same run with other disturbances, as `disturbances.parse` takes them.

        Raises:
            ConfigError: they are impossible.
        """
        try:
            spec = self.task_spec.disturbed(text)
        except InputError as error:
            raise ConfigError(f"disturb = {text!r}: {error}") from error
        return self.parse(self.model_dump() | {"task_spec": spec, "disturb": text})

    @classmethod
    def for_task(cls, task: str, **changes: Any) -> Self:
        """The task's preset with some values changed; the task is looked up among those installed here.

        Raises:
            ConfigError: a value is unknown or outside its range.
        """
        try:
            preset = preset_of(task)
        except InputError as error:
            raise ConfigError(str(error)) from error
        return cls.bare(task, **preset | implied(changes.get("algorithm", "bpn")) | changes)

    @classmethod
    def bare(cls, task: str, **values: Any) -> Self:
        """The task without its preset: the fields' defaults stand in for what is not given.

        Raises:
            ConfigError: a value is unknown or outside its range.
        """
        for name in _BY_VALUE:
            if name in values:
                raise ConfigError(f"{name}: follows from the name; one of: {', '.join(OPTIONS)}")
        options = {name: v for name, v in values.items() if name in TaskOptions.model_fields}
        try:
            spec = task_spec(task, TaskOptions.model_validate(options))
        except ValidationError as error:
            raise ConfigError(describe(error, "")) from error
        except InputError as error:
            raise ConfigError(str(error)) from error
        return cls.parse(_own_options(values) | {"task": task, "task_spec": spec})

    @classmethod
    def parse(cls, values: object, *, source: str = "") -> Self:
        """Validates values from outside; `source`, if any, says in errors where they came from.

        Raises:
            ConfigError: a value is unknown or outside its range.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise ConfigError(describe(error, source)) from error

    @classmethod
    def from_json(cls, data: bytes, *, source: str) -> Self:
        """Validates JSON from a file or the wire.

        Raises:
            ConfigError: not JSON, or a value is wrong.
        """
        try:
            return cls.model_validate_json(data)
        except ValidationError as error:
            raise ConfigError(describe(error, source)) from error


def _algorithm_spec(name: object) -> AlgorithmSpec:
    try:
        return find_algorithm(str(name)).spec
    except InputError as error:
        raise ValueError(f"algorithm = {name!r}: {error}") from error


def _own_options(values: dict[str, Any]) -> dict[str, Any]:
    """The values with the algorithm's own options, all of them and checked by the algorithm.

    Raises:
        ConfigError: one is unknown or outside its range.
    """
    name, given = values.get("algorithm", "bpn"), values.get("algorithm_options", "")
    try:
        algorithm = find_algorithm(str(name))
        options = algorithm.checked(AlgorithmValues(algorithm_options=given).own_options)
    except ValidationError:  # which is said with whatever else is wrong
        return values
    except InputError as error:
        raise ConfigError(f"algorithm = {name!r}: {error}") from error
    except ValueError as error:
        raise ConfigError(f"algorithm_options of {name!r}: {error}") from error
    return values | {"algorithm_options": json.dumps(options, sort_keys=True) if options else ""}


_FIRST = ("task", "algorithm", "seed")
_BY_VALUE = ("task_spec", "algorithm_spec")
OPTIONS = (
    *_FIRST,
    *(name for name in RunConfig.model_fields if name not in (*_FIRST, *_BY_VALUE)),
)
"""What whoever creates a run may give: task and algorithm by their names, and values."""


def describe(error: ValidationError, source: str) -> str:
    """A validation error as one line per value: its name, the value, what it must be."""
    lines = []
    for item in error.errors():
        name = ".".join(str(part) for part in item["loc"])
        value = "" if isinstance(item["input"], dict) else f" = {item['input']!r}"
        # where several values do not fit together, the message names them
        what = f"{name}{value}: " if name else ""
        whence = f"{source}: " if source else ""
        lines.append(f"{whence}{what}{_remedy(name, item['type'], item['msg'])}")
    return "\n".join(lines)


_FORMS = {
    "init_from": "must be RUN or RUN:VERSION, RUN a run's id or its end (digits, a to f, -)",
    "callbacks": "must be names of installed callbacks, separated by commas",
}
"""What a pattern wants, in words."""


def _remedy(name: str, kind: str, message: str) -> str:
    if kind == "string_pattern_mismatch" and name in _FORMS:
        return _FORMS[name]
    if kind == "extra_forbidden":
        return called_now(name) or f"unknown; one of: {', '.join(OPTIONS)}"
    return message.removeprefix("Value error, ")
