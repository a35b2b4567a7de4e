"""Hedged Q-learning: what it is, and how it acts. Edges and whoever creates a run import this, so: no torch."""

from collections.abc import Callable
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from bpn_shared.bnn.outputs import Outputs
from bpn_shared.messages.control import Assignment
from bpn_shared.spec.algorithms import Algorithm, AlgorithmSpec
from bpn_shared.spec.config import RunConfig

Share = Annotated[float, Field(ge=0, le=1)]


class Options(BaseModel):
    """`--algorithm-options '{"explore": 0.2}'`: what is not given is as here."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    hedge: Share = 0.2
    """Of what follows, how much is what any action would bring, and not the best."""
    explore: Share = 0.1
    """Of actions, how many are any."""


HEDGED = Algorithm(
    AlgorithmSpec(
        name="hedged",
        title="Hedged Q-learning",
        network="binary",
        targets="hedged",
        selection="hedged",
        preset={"relative_targets": True},
    ),
    Options,
)


def select(
    config: RunConfig, _assignment: Assignment, _scale: float
) -> Callable[[Outputs, float], int]:
    """How an edge acts: from outputs [|A|] and a uniform number in [0, 1) to an action."""
    explore = Options(**config.own_options).explore

    def action(outputs: Outputs, uniform: float) -> int:
        if uniform < explore:
            return min(int(uniform / explore * len(outputs)), len(outputs) - 1)
        return int(outputs.argmax())

    return action
