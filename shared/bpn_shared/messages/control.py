"""Requests between services: reset of a robot, hand-out of episodes, acknowledgements."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from bpn_shared.messages.base import ULONG, Message
from bpn_shared.spec.algorithms import SOFTMAX, PluginName

Count = Annotated[int, Field(ge=0, lt=2**32)]
Seed = Annotated[int, Field(ge=0, lt=ULONG)]
WorkerId = Annotated[
    str, Field(min_length=1, max_length=64, pattern=r"^([a-z0-9-]+\.)?[a-z0-9-]+$")
]
"""With the worker's site before the dot (`bpn_shared.site`)."""
MAX_REASON = 500
Reason = Annotated[str, Field(max_length=MAX_REASON)]
Version = Annotated[str, Field(max_length=64)]
EpisodeName = Annotated[tuple[Count, Count], Strict(False)]
"""(iteration, episode); a list on the wire, which msgpack has for both."""


class Reset(Message):
    """edge -> robot: begin this episode. Repeating one with the same `reset_id` changes nothing."""

    iteration: Count
    episode: Count
    seed: Seed
    reset_id: Seed


class ResetReply(Message):
    """robot -> edge: taken; frames follow."""

    reset_id: Seed


class NextEpisode(Message):
    """edge -> learner: what shall slot play next?"""

    SCHEMA: ClassVar[int] = 2
    OLDER_SCHEMAS: ClassVar[frozenset[int]] = frozenset({1})

    slot: Count
    worker: WorkerId
    weights_version: Count | None = None
    """The newest that the edge has loaded and verified; None: none yet."""
    in_hand: EpisodeName | None = None
    """Played, and delivered while the next one is played: not to be given to this slot again. None: nothing."""


class Assignment(Message):
    """learner -> edge: play this episode (`play`), ask again later (`wait`), or stop (`finished`).

    `weights_version` is what every episode of the iteration must use: theta-minus is fixed while data
    is collected (Algorithm 1).
    """

    status: Literal["play", "wait", "finished"]
    reason: Reason = ""
    iteration: Count = 0
    episode: Count = 0
    seed: Seed = 0
    weights_attempt: Count = 0
    weights_version: Count = 0
    policy: PluginName = SOFTMAX
    """What draws the actions, a plug-in of bpn.selections."""
    epsilon: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Of the epsilon-greedy policy: 0 plays greedily, 1 at random."""


class EpisodeReceipt(Message):
    """learner -> edge: the episode is on disk (`stored`), was there already (`duplicate`), or is not wanted.

    Whatever the status, the edge must not send it again.
    """

    status: Literal["stored", "duplicate", "refused"]
    reason: Reason = ""


class Fault(Message):
    """edge, robot -> learner: this episode cannot be had, and why.

    Where seed and weights fix what happens, so does the next try: the learner fails the run when it is told the
    same thing again and again.
    """

    iteration: Count
    episode: Count
    worker: WorkerId
    reason: Annotated[str, Field(min_length=1, max_length=MAX_REASON)]


class FaultReceipt(Message):
    """learner -> edge, robot: noted."""
