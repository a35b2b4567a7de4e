"""What goes beyond the paper's Algorithm 1: each value's default leaves it as printed, bit by bit."""

from typing import Annotated

from pydantic import BaseModel, Field


class BeyondThePaper(BaseModel):
    """Options of targets, data and updates (docs/algorithms)."""

    n_step: Annotated[
        int,
        Field(ge=1, le=100, description="steps of an episode that a target adds up (the paper: 1)"),
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
