"""The configuration of a run: its task by value, and the paper's Table I with a range for every value."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from bpn_shared.errors import InputError
from bpn_shared.spec.algorithms import ALGORITHMS, KERNELS, Algorithm, AlgorithmName, implied
from bpn_shared.spec.disturbances import of_scope, shown
from bpn_shared.spec.gym import GymOptions
from bpn_shared.spec.installed import preset_of, task_spec
from bpn_shared.spec.learning import BeyondThePaper
from bpn_shared.spec.network import MAX_NODES, NetworkSpec
from bpn_shared.spec.stopping import StopRule
from bpn_shared.spec.tasks import MAX_NAME, NAME_PATTERN, TaskOptions, TaskSpec, is_gym

Pacing = Literal["lockstep", "realtime"]
Kernel = str
"""Name of an installed kernel."""
Policy = Literal["softmax", "epsilon_greedy"]
"""How an action is drawn from a network's outputs."""
Device = Literal["cpu", "cuda"]
Engine = Literal["fast", "plain"]

CALLBACKS_PATTERN = r"^$|^[A-Za-z0-9][\w.-]*(,[A-Za-z0-9][\w.-]*)*$"
INIT_FROM_PATTERN = r"^$|^[0-9a-f-]{1,36}(:\d{1,9}(:[0-9a-f]{64})?)?$"
MAX_STEPS = 1000
MAX_LEARNERS = 64
MAX_ACTION_DELAY_MS = 2000.0


_AS_THE_TASK = ("frame_channels", "frames_stacked", "frame_skip", "actions")
"""Options whose 0 is whatever the task has."""
_OWN_KERNELS = frozenset(name for names in KERNELS.values() for name in names)
"""Of the others, only the edge that has them can say what they run."""


class ConfigError(InputError):
    """A configuration value is wrong; the message names the value, its range and where it came from."""


class RunConfig(BeyondThePaper, TaskOptions):
    """One training. Field names are the command line's options; symbols are the paper's.

    Whoever creates a run makes it by the task's name, with `for_task`; everybody else reads it, and knows the task
    from `task_spec` alone.
    """

    task: Annotated[
        str,
        Field(pattern=NAME_PATTERN, max_length=MAX_NAME, description="what the robot learns"),
    ]
    task_spec: Annotated[TaskSpec, Field(description="the task itself, as it is named")]
    algorithm: Annotated[
        AlgorithmName,
        Field(
            description="binary network: bpn (CVI), bqn (DQN); float network: cvi, dqn, dpp (CVI, alpha = 1)"
        ),
    ] = "bpn"
    seed: Annotated[int, Field(ge=0, lt=2**63, description="seed of everything random")] = 0

    iterations: Annotated[int, Field(ge=1, le=100_000, description="I, policy updates")] = 50
    episodes: Annotated[int, Field(ge=1, le=10_000, description="E, episodes an iteration")] = 10
    steps: Annotated[int, Field(ge=1, le=MAX_STEPS, description="T, steps an episode")] = 20
    epochs: Annotated[int, Field(ge=1, le=10_000, description="C, epochs an update")] = 50
    batch: Annotated[int, Field(ge=2, le=4096, description="B, minibatch size")] = 32
    datasets: Annotated[int, Field(ge=1, le=1000, description="U, newest data sets in D")] = 3

    alpha: Annotated[float, Field(ge=0, le=1, description="GIO coefficient of CVI")] = 0.95
    beta: Annotated[float, Field(gt=0, le=1e4, description="inverse temperature of CVI")] = 1.0
    gamma: Annotated[float, Field(ge=0, lt=1, description="discount factor")] = 0.99
    mask_terminals: Annotated[
        bool,
        Field(description="no bootstrap from terminal states (Algorithm 1 as printed: bootstrap)"),
    ] = False
    relative_targets: Annotated[
        bool, Field(description="subtract the targets' mean over D (Algorithm 1 as printed: no)")
    ] = False
    epsilon_initial: Annotated[
        float, Field(ge=0, le=1, description="bqn, dqn: share of random actions in iteration 0")
    ] = 1.0
    epsilon_final: Annotated[
        float, Field(ge=0, le=1, description="bqn, dqn: share of random actions at the end")
    ] = 0.05

    nodes: Annotated[int, Field(ge=1, le=MAX_NODES, description="N, nodes of FC(N)")] = 100
    learning_rate: Annotated[float, Field(gt=0, le=1, description="of Adam")] = 1e-3
    learning_rate_final: Annotated[
        float, Field(ge=0, le=1, description="share of it at an update's end (cosine over epochs)")
    ] = 0.02
    learning_rate_last: Annotated[
        float, Field(ge=0, le=1, description="share of it in the last iteration (linear)")
    ] = 0.1
    scale_initial: Annotated[
        float, Field(gt=0, le=100, description="binary: lambda at the start")
    ] = 0.2
    reward_scale: Annotated[
        float, Field(gt=0, le=1e3, description="factor on rewards in pixels before learning")
    ] = 0.1

    engine: Annotated[
        Engine,
        Field(description="of policy updates; plain: the readable reference, several times slower"),
    ] = "fast"

    learners: Annotated[
        int,
        Field(
            ge=1,
            le=MAX_LEARNERS,
            description="learners that share each policy update; pays for large minibatches",
        ),
    ] = 1
    device: Annotated[
        Device, Field(description="where torch computes; weights are bit-reproducible on cpu alone")
    ] = "cpu"

    tensorboard: Annotated[
        bool, Field(description="also write TensorBoard event files into the run folder")
    ] = False
    init_from: Annotated[
        str,
        Field(
            max_length=200,
            pattern=INIT_FROM_PATTERN,
            description="run whose newest weights it begins with, RUN[:VERSION]; kept with their SHA-256",
        ),
    ] = ""
    evaluate_every: Annotated[
        int,
        Field(
            ge=0,
            le=100_000,
            description="iterations from one evaluation to the next, greedy episodes that are no data, of which "
            "the best policy is noted; 0: none",
        ),
    ] = 0
    evaluate_episodes: Annotated[
        int, Field(ge=1, le=1000, description="episodes of an evaluation during training")
    ] = 10
    stop_when: Annotated[
        str,
        Field(max_length=100, description="end early once this holds: 'eval_return >= 475'"),
    ] = ""
    callbacks: Annotated[
        str,
        Field(
            max_length=200,
            pattern=CALLBACKS_PATTERN,
            description="installed callbacks, separated by commas: what else is done during training",
        ),
    ] = ""

    robots: Annotated[int, Field(ge=1, le=64, description="slots: robots, each with its edge")] = 1
    pacing: Annotated[
        Pacing, Field(description="lockstep: the robot waits for the action; realtime: it does not")
    ] = "lockstep"
    action_delay_ms: Annotated[
        float,
        Field(
            ge=0,
            le=MAX_ACTION_DELAY_MS,
            description="realtime pacing: time added between a frame and its action's effect",
        ),
    ] = 0.0
    kernel: Annotated[
        Kernel,
        Field(
            max_length=60,
            pattern=r"^[A-Za-z0-9][\w.-]*$",
            description="what runs the policy at the edge; native, golden: binary, onnx: float; or your own",
        ),
    ] = "native"

    @model_validator(mode="before")
    @classmethod
    def _fill_implied(cls, values: Any) -> Any:
        """What task and algorithm imply stands in for what was not given."""
        if not isinstance(values, dict):
            return values
        given = {
            name: v for name, v in values.items() if not (name in _AS_THE_TASK and v in (0, "0"))
        }
        of_task = values.get("task_spec")
        if isinstance(of_task, TaskSpec):
            given = of_task.options() | given
        elif isinstance(of_task, dict):
            of_gym = of_task.get("gym")
            told = of_task | (of_gym if isinstance(of_gym, dict) else {})
            given = {name: told[name] for name in TaskOptions.model_fields if name in told} | given
            given.setdefault("disturb", shown(of_task.get("disturbances", {})))
        return implied(str(given.get("algorithm"))) | given

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
        kernels = KERNELS[self.algorithm_spec.network]
        if self.kernel in _OWN_KERNELS and self.kernel not in kernels:
            raise ValueError(
                f"kernel = {self.kernel!r} does not run the network of {self.algorithm!r}, which is "
                f"{self.algorithm_spec.network}; one of: {', '.join(kernels)}"
            )
        if self.algorithm == "dpp" and self.alpha != 1:
            raise ValueError(
                f"alpha = {self.alpha}: dpp is CVI with alpha = 1; leave alpha out, or choose cvi"
            )
        return self

    @model_validator(mode="after")
    def _parts_for_all_learners(self) -> Self:
        if self.learners > self.batch:
            raise ValueError(
                f"learners = {self.learners} with batch = {self.batch}: a minibatch is shared by all of them, "
                "so it needs at least as many transitions"
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

    @property
    def algorithm_spec(self) -> Algorithm:
        return ALGORITHMS[self.algorithm]

    @property
    def network(self) -> NetworkSpec:
        return self.task_spec.network(self.nodes)

    @property
    def policy(self) -> Policy:
        """What data are collected with: CVI's policy is its softmax, DQN explores epsilon-greedily."""
        return "softmax" if self.algorithm_spec.update == "cvi" else "epsilon_greedy"

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
        """Share of uniformly random actions in an iteration: 0 for CVI, whose policy is stochastic.

        For DQN it falls linearly from `epsilon_initial` to `epsilon_final` over the first half of the run.
        """
        if self.policy == "softmax":
            return 0.0
        progress = min(1.0, 2 * iteration / self.iterations)
        return self.epsilon_initial + progress * (self.epsilon_final - self.epsilon_initial)

    def learning_rate_share(self, iteration: int) -> float:
        """Of the learning rate, in an iteration: from 1 linearly to `learning_rate_last`."""
        progress = iteration / max(1, self.iterations - 1)
        return 1 + progress * (self.learning_rate_last - 1)

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
        return cls.bare(task, **preset | implied(changes.get("algorithm", "")) | changes)

    @classmethod
    def bare(cls, task: str, **values: Any) -> Self:
        """The task without its preset: the fields' defaults stand in for what is not given.

        Raises:
            ConfigError: a value is unknown or outside its range.
        """
        if "task_spec" in values:
            raise ConfigError(f"task_spec: follows from the task; one of: {', '.join(OPTIONS)}")
        options = {name: v for name, v in values.items() if name in TaskOptions.model_fields}
        try:
            spec = task_spec(task, TaskOptions.model_validate(options))
        except ValidationError as error:
            raise ConfigError(describe(error, "")) from error
        except InputError as error:
            raise ConfigError(str(error)) from error
        return cls.parse(values | {"task": task, "task_spec": spec})

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


_FIRST = ("task", "algorithm", "seed")
OPTIONS = (*_FIRST, *(n for n in RunConfig.model_fields if n not in (*_FIRST, "task_spec")))
"""What whoever creates a run may give: the task by its name, and values."""


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
        return f"unknown; one of: {', '.join(OPTIONS)}"
    return message.removeprefix("Value error, ")
