"""edge -> whoever watches: what the policy decided for one frame, and why."""

from typing import Annotated

from pydantic import Field

from bpn_shared.messages.base import ULONG, Message
from bpn_shared.messages.control import Count

MAX_ACTIONS = 64


class Decision(Message):
    """One decision, of those at most 20 a second that are published.

    Attributes:
        outputs: the network's o, one integer per action.
        scale: lambda; the action preferences are P = lambda * o (Eq. 14).
        time_ns: unix time when the action had been sent.
    """

    iteration: Count
    episode: Count
    step: Count
    action: Count
    outputs: Annotated[
        list[Annotated[int, Field(ge=-(2**31), lt=2**31)]],
        Field(min_length=1, max_length=MAX_ACTIONS),
    ]
    scale: float
    weights_version: Count
    inference_ns: Count
    edge_ns: Count
    time_ns: Annotated[int, Field(ge=0, lt=ULONG)]
