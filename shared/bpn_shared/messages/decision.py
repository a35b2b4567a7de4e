"""edge -> whoever watches: what the policy decided for one frame, and why."""

from typing import Annotated

from pydantic import Field

from bpn_shared.messages.base import ULONG, Message
from bpn_shared.messages.control import Count
from bpn_shared.spec.network import MAX_ACTIONS


class Decision(Message):
    """One decision, of those at most 20 a second that are published.

    Attributes:
        action: its number, of 0..joint_actions-1 of the task.
        outputs: what the network said, one number per action: o, integers, or P of a float policy; of an action
            of several dimensions, one per choice, the dimensions' side by side.
        scale: lambda, so that the action preferences are P = lambda * o (Eq. 14); 1 of a float policy.
        time_ns: unix time when the action had been sent.
    """

    iteration: Count
    episode: Count
    step: Count
    action: Annotated[int, Field(ge=0, lt=ULONG)]
    outputs: Annotated[
        list[Annotated[float, Field(allow_inf_nan=False)]],
        Field(min_length=1, max_length=MAX_ACTIONS),
    ]
    scale: float
    weights_version: Count
    inference_ns: Count
    edge_ns: Count
    time_ns: Annotated[int, Field(ge=0, lt=ULONG)]
