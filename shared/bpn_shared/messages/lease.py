"""Requests about who works where: a worker asks the registry, the registry tells it to let go."""

from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field, Strict

from bpn_shared.messages.base import Message
from bpn_shared.messages.control import Count, Reason, Version, WorkerId

Role = Literal["learner", "robot_sim", "edge"]
MAX_PLUGIN_NAME, MAX_PLUGINS = 60, 200
PluginName = Annotated[str, Field(max_length=MAX_PLUGIN_NAME)]
PluginNames = Annotated[tuple[PluginName, ...], Field(max_length=MAX_PLUGINS), Strict(False)]
"""A list on the wire, which msgpack has for both."""
RunId = Annotated[str, Field(pattern=r"^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$")]


class GiveBack(Message):
    """A place that a worker could not use, and why."""

    run: RunId
    slot: Count
    reason: Reason


class LeaseRequest(Message):
    """worker -> registry: I am idle, what shall I work on?

    Attributes:
        label: where the worker runs; a robot and an edge with equal labels are put together.
        version, protocol: of the worker's program (`bpn_shared.version`); empty and 1 of one that did not tell.
        gave_back: the last place that it gave back, until the registry has answered once.
        gpu: whether torch finds one there; None: not told, as of workers that need none.
        plugins: by entry-point group, the names of those that can be used there; a group that is not there was not
            told.
    """

    SCHEMA = 3
    OLDER_SCHEMAS = frozenset({1, 2})

    role: Role
    worker: WorkerId
    label: Annotated[str, Field(max_length=100)] = ""
    version: Version = ""
    protocol: Count = 1
    gave_back: GiveBack | None = None
    gpu: bool | None = None
    plugins: Annotated[dict[PluginName, PluginNames], Field(max_length=20, default_factory=dict)]


class LeaseReply(Message):
    """registry -> worker: work on this (`lease`), or ask again after `retry_s` (`wait`)."""

    status: Literal["lease", "wait"]
    run: RunId | None = None
    slot: Count = 0
    retry_s: Annotated[float, Field(gt=0, le=60)] = 1.0

    @property
    def run_id(self) -> UUID | None:
        return None if self.run is None else UUID(self.run)


class Release(Message):
    """registry -> worker: stop working on this run. That the worker's token goes is the answer."""

    run: RunId
    reason: Reason = ""


class ReleaseReply(Message):
    """worker -> registry: understood; `working` is false if it does not work on that run."""

    working: bool
