"""The values of a configuration, in its sections: what is learned by which algorithm, the training, its execution.

Table I of the paper with a range for every value; symbols are the paper's. A run's weights are a function of the
task, the algorithm and the training alone. What stands in the section `execution` is where and with what it is
done, and what is done beside it: it changes no more of the result than rounding does, and two runs that differ in
nothing else are told to be alike.
"""

import json
from math import isfinite
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from bpn_shared.errors import InputError
from bpn_shared.spec.algorithms import MAX_NAME, NAME_PATTERN
from bpn_shared.spec.disturbances import of_scope, parse, shown
from bpn_shared.spec.network import (
    MAX_HIDDEN_UNITS,
    PAPER_CONVOLUTIONS,
    format_convolutions,
    parse_convolutions,
)

Pacing = Literal["lockstep", "realtime"]
Device = Literal["cpu", "cuda"]
Backend = Literal["native", "torch"]

CALLBACKS_PATTERN = r"^$|^[A-Za-z0-9][\w.-]*(,[A-Za-z0-9][\w.-]*)*$"
INIT_FROM_PATTERN = r"^$|^[0-9a-f-]{1,36}(:\d{1,9}(:[0-9a-f]{64})?)?$"
MAX_STEPS = 1000
MAX_LEARNERS = 64
MAX_ACTION_DELAY_MS = 2000.0


def _options(text: str) -> str:
    try:
        found = json.loads(text or "{}", parse_constant=_no_number, parse_float=_finite)
    except (ValueError, RecursionError) as error:  # the latter of brackets within brackets
        raise ValueError(f"no JSON ({error}); such as '{{\"tau\": 0.9}}'") from error
    if not isinstance(found, dict):
        raise ValueError("must be a JSON object; such as '{\"tau\": 0.9}'")
    return json.dumps(found, sort_keys=True) if found else ""


def _automatic(value: object) -> object:
    """0 stands for what is found out, and may be called by its name."""
    return 0.0 if value == "auto" else value


def _of_pictures(text: str) -> str:
    try:
        levels = parse(text)
    except InputError as error:
        raise ValueError(str(error)) from error
    others = levels.keys() - of_scope(levels, "picture").keys()
    if others:
        raise ValueError(f"{', '.join(sorted(others))}: concerns no pictures; leave it out")
    return shown(levels)


def _convolutions(text: str) -> str:
    return format_convolutions(parse_convolutions(text))


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _finite(text: str) -> float:
    if not isfinite(number := float(text)):
        raise ValueError(f"{text} is too large a number")
    return number


class AlgorithmValues(BaseModel):
    """What every algorithm of the family may have, and the options of one's own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    alpha: Annotated[float, Field(ge=0, le=1, description="GIO coefficient of CVI")] = 0.95
    beta: Annotated[float, Field(gt=0, le=1e4, description="inverse temperature of CVI")] = 1.0
    beta_run_final_factor: Annotated[
        float, Field(ge=1, le=1e3, description="factor on it in the last iteration (linear)")
    ] = 1.0
    gamma: Annotated[float, Field(ge=0, lt=1, description="discount factor")] = 0.99
    bootstrap_terminals: Annotated[
        bool,
        Field(
            description="bootstrap from terminal states too, as Algorithm 1 is printed; no: they are worth 0"
        ),
    ] = True
    relative_targets: Annotated[
        bool, Field(description="subtract the targets' mean over D (Algorithm 1 as printed: no)")
    ] = False
    n_step: Annotated[
        int,
        Field(
            ge=1, le=100, description="steps of an episode that a target adds up (Algorithm 1: 1)"
        ),
    ] = 1
    gap_floor: Annotated[
        float,
        Field(
            ge=0,
            le=1e6,
            description="how far below a state's value an action's preference counts in CVI's target, at most; "
            "0: however far",
        ),
    ] = 0.0
    epsilon_initial: Annotated[
        float, Field(ge=0, le=1, description="bqn, dqn: share of random actions in iteration 0")
    ] = 1.0
    epsilon_final: Annotated[
        float, Field(ge=0, le=1, description="bqn, dqn: share of random actions at the end")
    ] = 0.05
    algorithm_options: Annotated[
        str,
        AfterValidator(_options),
        Field(max_length=4000, description="an algorithm's own options, as JSON"),
    ] = ""

    @property
    def own_options(self) -> dict[str, Any]:
        """The algorithm's own options."""
        found: dict[str, Any] = json.loads(self.algorithm_options or "{}")
        return found


class TrainingValues(BaseModel):
    """How much is learned, from which data, and how fast."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: Annotated[int, Field(ge=0, lt=2**63, description="seed of everything random")] = 0
    iterations: Annotated[int, Field(ge=1, le=100_000, description="I, policy updates")] = 50
    episodes: Annotated[int, Field(ge=1, le=10_000, description="E, episodes an iteration")] = 10
    steps: Annotated[int, Field(ge=1, le=MAX_STEPS, description="T, steps an episode")] = 20
    epochs: Annotated[int, Field(ge=1, le=10_000, description="C, epochs an update")] = 50
    batch_size: Annotated[int, Field(ge=2, le=4096, description="B, minibatch size")] = 32
    replay_iterations: Annotated[
        int, Field(ge=1, le=1000, description="U, newest iterations whose episodes are D")
    ] = 3
    replay_transitions: Annotated[
        int,
        Field(
            ge=0,
            le=10_000_000,
            description="D is the newest whole iterations with at most so many transitions; 0: it is U iterations",
        ),
    ] = 0
    max_updates: Annotated[
        int,
        Field(
            ge=0,
            le=10_000_000,
            description="optimizer steps of a policy update, at most; 0: C epochs",
        ),
    ] = 0
    augment: Annotated[
        str,
        AfterValidator(_of_pictures),
        Field(
            max_length=500,
            description="each update also fits D's pictures disturbed anew, noise=0..25,offset=-30..30 say "
            "(docs/disturbances.md)",
        ),
    ] = ""

    hidden_units: Annotated[
        int, Field(ge=1, le=MAX_HIDDEN_UNITS, description="N, hidden units, of FC(N)")
    ] = 100
    conv: Annotated[
        str,
        AfterValidator(_convolutions),
        Field(
            max_length=100,
            description="convolutions before FC(N): KERNELxSTRIDExCHANNELS of each, separated by commas",
        ),
    ] = format_convolutions(PAPER_CONVOLUTIONS)
    learning_rate: Annotated[float, Field(gt=0, le=1, description="of Adam")] = 1e-3
    lr_update_final_factor: Annotated[
        float, Field(ge=0, le=1, description="share of it at an update's end (cosine over epochs)")
    ] = 0.02
    lr_run_final_factor: Annotated[
        float, Field(ge=0, le=1, description="share of it in the last iteration (linear)")
    ] = 0.1
    scale_initial: Annotated[
        float,
        BeforeValidator(_automatic),
        Field(
            ge=0,
            le=100,
            description="binary: lambda at the start; 0 or auto: as the first policy is nearly uniform with",
        ),
    ] = 0.2
    reward_scale: Annotated[
        float,
        BeforeValidator(_automatic),
        Field(
            ge=0,
            le=1e3,
            description="factor on rewards before learning; 0 or auto: 10 over the range of the first data's "
            "returns over n_step steps",
        ),
    ] = 0.1

    init_from: Annotated[
        str,
        Field(
            max_length=200,
            pattern=INIT_FROM_PATTERN,
            description="run whose newest weights it begins with, RUN[:VERSION]; kept with their SHA-256",
        ),
    ] = ""
    stop_when: Annotated[
        str,
        Field(max_length=100, description="end early once this holds: 'eval_return >= 475'"),
    ] = ""
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


class ExecutionValues(BaseModel):
    """Where and with what a run is done, and what is done beside it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    backend: Annotated[
        Backend,
        Field(description="of policy updates; torch: the readable reference, several times slower"),
    ] = "native"
    device: Annotated[
        Device, Field(description="where torch computes; weights are bit-reproducible on cpu alone")
    ] = "cpu"
    learners: Annotated[
        int,
        Field(
            ge=1,
            le=MAX_LEARNERS,
            description="learners that share each policy update; pays for large minibatches",
        ),
    ] = 1
    robots: Annotated[int, Field(ge=1, le=64, description="slots: robots, each with its edge")] = 1
    kernel: Annotated[
        str,
        Field(
            max_length=MAX_NAME,
            pattern=rf"^$|{NAME_PATTERN}",
            description="what shall run the policy at every edge (native, golden: binary, onnx: float; or your "
            "own); none: whatever an edge has",
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
    callbacks: Annotated[
        str,
        Field(
            max_length=200,
            pattern=CALLBACKS_PATTERN,
            description="installed callbacks, separated by commas: what else is done during training",
        ),
    ] = ""
    tensorboard: Annotated[
        bool, Field(description="also write TensorBoard event files into the run folder")
    ] = False


SECTIONS: dict[str, type[BaseModel]] = {
    "algorithm": AlgorithmValues,
    "training": TrainingValues,
    "execution": ExecutionValues,
}
"""Of a configuration's values but for the task's."""
LEARNED = ("task", "algorithm", "training")
"""The sections that say what is learned."""
ADDED = {
    "algorithm": ("beta_run_final_factor", "n_step", "gap_floor"),
    "training": ("conv", "replay_transitions", "max_updates", "augment"),
}
"""Values that came later, by section: their defaults are no part of a configuration's hash."""
