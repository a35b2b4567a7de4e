"""The configuration of a run: the paper's Table I with a range for every value, and presets per task."""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from bpn_shared.errors import InputError
from bpn_shared.spec.algorithms import ALGORITHMS, KERNELS, Algorithm, AlgorithmName, implied
from bpn_shared.spec.network import MAX_ACTIONS, MAX_CHANNELS, MAX_NODES, NetworkSpec
from bpn_shared.spec.stopping import StopRule
from bpn_shared.spec.tasks import TASKS, Task, check_task_name, gym_task, is_gym

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


_OWN_KERNELS = frozenset(name for names in KERNELS.values() for name in names)
"""Of the others, only the edge that has them can say what they run."""


class ConfigError(InputError):
    """A configuration value is wrong; the message names the value, its range and where it came from."""


class RunConfig(BaseModel):
    """One training. Field names are the command line's options; symbols are the paper's."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    task: Annotated[str, Field(description="what the robot learns")] = "reaching"
    algorithm: Annotated[
        AlgorithmName,
        Field(
            description="binary network: bpn (CVI), bqn (DQN); float network: cvi, dqn, dpp (CVI, alpha = 1)"
        ),
    ] = "bpn"
    seed: Annotated[int, Field(ge=0, lt=2**63, description="seed of everything random")] = 0

    frame_channels: Annotated[
        int, Field(ge=0, le=3, description="gym tasks: 1 gray, 3 RGB; 0: as the task has it")
    ] = 0
    frames_stacked: Annotated[
        int,
        Field(
            ge=0, le=MAX_CHANNELS, description="gym tasks: frames in an observation; 0: as the task"
        ),
    ] = 0
    frame_skip: Annotated[
        int,
        Field(ge=0, le=100, description="gym tasks: steps that an action takes; 0: as the task"),
    ] = 0
    actions: Annotated[
        int, Field(ge=0, le=MAX_ACTIONS, description="gym tasks: |A|; 0: found out by `bpn train`")
    ] = 0

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
            name: v for name, v in values.items() if not (name in _TASK_FIELDS and v in (0, "0"))
        }
        of_task = _of_task(str(given.get("task", "reaching")))
        return of_task | implied(str(given.get("algorithm"))) | given

    @field_validator("task")
    @classmethod
    def _possible_task(cls, name: str) -> str:
        return check_task_name(name)

    @model_validator(mode="after")
    def _fits_task(self) -> Self:
        if is_gym(self.task):
            if self.pacing == "realtime":
                raise ValueError(
                    f"pacing = 'realtime': {self.task!r} has no clock of its own; choose lockstep"
                )
            self.task_spec  # noqa: B018 - raises for values that no task can have
            return self
        for name, value in _of_task(self.task).items():
            if getattr(self, name) != value:
                raise ValueError(
                    f"{name} = {getattr(self, name)}: task {self.task!r} has {value}; leave it out"
                )
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
            StopRule.parse(self.stop_when)
        return self

    @model_validator(mode="after")
    def _delay_needs_time(self) -> Self:
        if self.action_delay_ms and self.pacing == "lockstep":
            raise ValueError(
                f"action_delay_ms = {self.action_delay_ms} means nothing in lockstep, where the robot "
                "waits for the action: set pacing = realtime"
            )
        return self

    @property
    def algorithm_spec(self) -> Algorithm:
        return ALGORITHMS[self.algorithm]

    @property
    def task_spec(self) -> Task:
        if is_gym(self.task):
            return gym_task(
                self.task,
                frame_channels=self.frame_channels,
                frames_stacked=self.frames_stacked,
                frame_skip=self.frame_skip,
                actions=self.actions,
            )
        return TASKS[self.task]

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

    @classmethod
    def for_task(cls, task: str, **changes: Any) -> Self:
        """The task's preset with some values changed.

        Raises:
            ConfigError: a value is unknown or outside its range.
        """
        preset = preset_of(task) | implied(changes.get("algorithm", ""))
        return cls.parse({"task": task} | preset | changes)

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


PRESETS: dict[str, dict[str, Any]] = {
    # Table I; what it leaves open (optimizer, scales) was found by experiment, see docs/algorithms.
    "reaching": {
        "steps": 20,
        "nodes": 256,
        "reward_scale": 0.1,
        "relative_targets": True,
        "learning_rate_last": 0.05,
    },
    "tracking": {
        "steps": 40,
        "nodes": 256,
        "reward_scale": 0.2,
        "relative_targets": True,
        "learning_rate_last": 0.05,
    },
    # Section VI-B.
    "pan_tilt": {
        "nodes": 100,
        "alpha": 0.95,
        "beta": 3.0,
        "iterations": 150,
        "steps": 80,
        "reward_scale": 0.1,
        "relative_targets": True,
        "learning_rate_last": 0.05,
    },
    # Three of its steps at once, because one moves the pole by less than a pixel; docs/tasks/gym.md.
    "gym:CartPole-v1": {
        "actions": 2,
        "frame_skip": 3,
        "nodes": 256,
        "alpha": 0.9,
        "gamma": 0.9,
        "iterations": 30,
        "episodes": 60,
        "steps": 100,
        "epochs": 10,
        "datasets": 6,
        "learning_rate": 3e-3,
        "learning_rate_last": 0.1,
        "scale_initial": 0.05,
        "reward_scale": 0.6,
        "relative_targets": True,
    },
}


_GYM_PRESET: dict[str, Any] = {
    # Of whatever unit rewards are, and episodes end for good or bad: the usual treatment of terminals.
    "mask_terminals": True,
    "reward_scale": 1.0,
    "steps": 200,
}


def preset_of(task: str) -> dict[str, Any]:
    """Values that a task begins with where they differ from the fields' defaults; {} for an unknown one.

    "gym:" has those of a Gymnasium environment that has no preset of its own.
    """
    return _of_task(task) | (_GYM_PRESET if is_gym(task) else {}) | PRESETS.get(task, {})


_TASK_FIELDS = ("frame_channels", "frames_stacked", "frame_skip", "actions")


def _of_task(task: str) -> dict[str, int]:
    """What follows from the task; of a Gymnasium environment, gray frames in pairs, which show motion."""
    if is_gym(task):
        return {"frame_channels": 1, "frames_stacked": 2, "frame_skip": 1}
    known = TASKS.get(task)
    return {} if known is None else {name: getattr(known, name) for name in _TASK_FIELDS}


def describe(error: ValidationError, source: str) -> str:
    """A validation error as one line per value: its name, the value, what it must be."""
    lines = []
    for item in error.errors():
        name = ".".join(str(part) for part in item["loc"])
        value = "" if isinstance(item["input"], dict) else f" = {item['input']!r}"
        # where several values do not fit together, the message names them
        what = f"{name}{value}: " if name else ""
        whence = f"{source}: " if source else ""
        lines.append(f"{whence}{what}{_remedy(item['type'], item['msg'])}")
    return "\n".join(lines)


def _remedy(kind: str, message: str) -> str:
    if kind == "extra_forbidden":
        return f"unknown; one of: {', '.join(RunConfig.model_fields)}"
    return message.removeprefix("Value error, ")
