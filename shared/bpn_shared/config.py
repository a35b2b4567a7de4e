"""The configuration of a run: the paper's Table I with a range for every value, and presets per task."""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from bpn_shared.bnn.spec import MAX_NODES, NetworkSpec
from bpn_shared.tasks import Task, task_named

Pacing = Literal["lockstep", "realtime"]
Kernel = Literal["native", "golden"]
Algorithm = Literal["bpn", "bqn"]
Device = Literal["cpu", "cuda"]
Engine = Literal["fast", "plain"]

MAX_STEPS = 1000


class ConfigError(ValueError):
    """A configuration value is wrong; the message names the value, its range and where it came from."""


class RunConfig(BaseModel):
    """One training. Field names are the command line's options; symbols are the paper's."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    task: Annotated[str, Field(description="what the robot learns")] = "reaching"
    algorithm: Annotated[
        Algorithm, Field(description="bpn: binary network + CVI; bqn: binary network + DQN")
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
        bool, Field(description="no bootstrap from failures (Algorithm 1 as printed: bootstrap)")
    ] = False
    relative_targets: Annotated[
        bool, Field(description="subtract the targets' mean over D (Algorithm 1 as printed: no)")
    ] = False
    epsilon_initial: Annotated[
        float, Field(ge=0, le=1, description="bqn: share of random actions in iteration 0")
    ] = 1.0
    epsilon_final: Annotated[
        float, Field(ge=0, le=1, description="bqn: share of random actions at the end")
    ] = 0.05

    nodes: Annotated[int, Field(ge=1, le=MAX_NODES, description="N, nodes of FC(N)")] = 100
    learning_rate: Annotated[float, Field(gt=0, le=1, description="of Adam")] = 1e-3
    learning_rate_final: Annotated[
        float, Field(ge=0, le=1, description="share of it at an update's end (cosine over epochs)")
    ] = 0.02
    learning_rate_last: Annotated[
        float, Field(ge=0, le=1, description="share of it in the last iteration (linear)")
    ] = 0.1
    scale_initial: Annotated[float, Field(gt=0, le=100, description="lambda at the start")] = 0.2
    reward_scale: Annotated[
        float, Field(gt=0, le=1e3, description="factor on rewards in pixels before learning")
    ] = 0.1

    engine: Annotated[
        Engine,
        Field(description="of policy updates; plain: the readable reference, several times slower"),
    ] = "fast"

    device: Annotated[
        Device, Field(description="where torch computes; weights are bit-reproducible on cpu alone")
    ] = "cpu"

    robots: Annotated[int, Field(ge=1, le=64, description="slots: robots, each with its edge")] = 1
    pacing: Annotated[
        Pacing, Field(description="lockstep: the robot waits for the action; realtime: it does not")
    ] = "lockstep"
    kernel: Annotated[Kernel, Field(description="what runs the policy at the edge")] = "native"

    @field_validator("task")
    @classmethod
    def _known_task(cls, name: str) -> str:
        return task_named(name).name

    @model_validator(mode="after")
    def _relative_targets_bootstrap(self) -> Self:
        if self.relative_targets and self.mask_terminals:
            raise ValueError(
                "relative_targets = True with mask_terminals = True: a terminal's value of 0 has no "
                "meaning among values relative to their mean; switch one of them off"
            )
        return self

    @property
    def task_spec(self) -> Task:
        return task_named(self.task)

    @property
    def network(self) -> NetworkSpec:
        return self.task_spec.network(self.nodes)

    def epsilon(self, iteration: int) -> float:
        """Share of uniformly random actions in an iteration: 0 for CVI, whose policy is stochastic.

        For DQN it falls linearly from `epsilon_initial` to `epsilon_final` over the first half of the run.
        """
        if self.algorithm == "bpn":
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
        return cls.parse({"task": task, **PRESETS.get(task, {}), **changes}, source="options")

    @classmethod
    def parse(cls, values: object, *, source: str) -> Self:
        """Validates values from outside; `source` says in errors where they came from.

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
}


def describe(error: ValidationError, source: str) -> str:
    """A validation error as one line per value: its name, the value, what it must be."""
    lines = []
    for item in error.errors():
        name = ".".join(str(part) for part in item["loc"]) or "content"
        value = "" if isinstance(item["input"], dict) else f" = {item['input']!r}"
        lines.append(f"{source}: {name}{value}: {_remedy(item['type'], item['msg'])}")
    return "\n".join(lines)


def _remedy(kind: str, message: str) -> str:
    if kind == "extra_forbidden":
        return f"unknown; one of: {', '.join(RunConfig.model_fields)}"
    return message.removeprefix("Value error, ")
