"""any -> dashboard: a batch of (name, step, value, time)."""

from typing import Annotated

from pydantic import Field

from bpn_shared.messages.base import Message
from bpn_shared.messages.control import Count


class Point(Message):
    """One value of one metric; `step` is the iteration unless the metric's reference says otherwise."""

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[a-z0-9_./]+$")]
    step: Count
    value: float
    time_ns: Annotated[int, Field(ge=0, lt=2**64)]


class MetricsBatch(Message):
    """At most 500 points."""

    points: Annotated[list[Point], Field(max_length=500)]
