"""Requests between the learners that share a run's policy updates: where to meet for the next one."""

from typing import Annotated, Literal

from pydantic import Field

from bpn_shared.messages.base import Message
from bpn_shared.messages.control import Count, WorkerId


class RendezvousRequest(Message):
    """learner of rank 1 or above -> rank 0: I am here; where is the next update?"""

    rank: Count
    worker: WorkerId


class RendezvousReply(Message):
    """rank 0 -> another learner of the run: come there (`meet`), or ask again soon (`wait`)."""

    status: Literal["wait", "meet"]
    host: Annotated[str, Field(max_length=255)] = ""
    port: Annotated[int, Field(ge=0, lt=2**16)] = 0
