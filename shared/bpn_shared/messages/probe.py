"""dashboard -> robot: can this environment be a task, and what has a configuration to know of it?"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from bpn_shared.messages.base import Message
from bpn_shared.spec.gym import GymOptions
from bpn_shared.spec.network import MAX_ACTION_DIMS

MAX_NAME = 256
MAX_SENTENCE = 500


class ProbeRequest(Message, GymOptions):
    """Make this environment, look at it, and close it again."""

    SCHEMA: ClassVar[int] = 2
    OLDER_SCHEMAS: ClassVar[frozenset[int]] = frozenset({1})

    task: Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
    frame_channels: Literal[1, 3] = 1
    steps: Annotated[int, Field(ge=0, le=1000)] = 20
    """Random actions that are tried; 0 where nothing may move, as of a real robot."""


class ProbeReply(Message):
    """What was found; an environment that cannot be a task is a refusal, whose message is the reason."""

    SCHEMA: ClassVar[int] = 2
    OLDER_SCHEMAS: ClassVar[frozenset[int]] = frozenset({1})

    actions: Annotated[int, Field(ge=2)]
    """|A|, or the choices of all dimensions together."""
    dims: Annotated[
        tuple[Annotated[int, Field(ge=2)], ...], Field(max_length=MAX_ACTION_DIMS), Strict(False)
    ] = ()
    """Choices of each dimension of its actions; none: there is one."""
    seen: Literal["observations", "renders"]
    """Where its frames come from."""
    note: Annotated[str, Field(max_length=MAX_SENTENCE)] = ""
    """What the user should know, such as why it is rendered although it has images; "": nothing."""
