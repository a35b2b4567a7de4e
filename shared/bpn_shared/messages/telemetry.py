"""any -> dashboard, once a second while someone listens: how a service is."""

from typing import Annotated, Literal

from pydantic import Field

from bpn_shared.messages.base import ULONG, Message
from bpn_shared.messages.control import Count, Reason, Version, WorkerId

Kind = Annotated[str, Field(min_length=1, max_length=32, pattern=r"^[a-z0-9_]+$")]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[a-z0-9_.]+$")]
Natural = Annotated[int, Field(ge=0, lt=ULONG)]
NotNegative = Annotated[float, Field(ge=0)]
UnixTime = Annotated[float, Field(ge=-3e11, le=3e11)]
"""Seconds; years of four digits."""
Text = Annotated[str, Field(max_length=255)]
WeightsEvent = Literal["published", "loaded", "running"]


class KeyTraffic(Message):
    """Totals of one key in one direction since the service started; `dropped` as in `Tally`."""

    key: Annotated[str, Field(min_length=1, max_length=200)]
    direction: Literal["sent", "received"]
    messages: Natural
    bytes: Natural
    dropped: Natural


class Percentiles(Message):
    """Durations of the last seconds."""

    count: Count
    p50_us: float
    p95_us: float
    p99_us: float
    max_us: float


class WeightsMark(Message):
    """When weights were published, loaded into a bank, or made the running ones."""

    attempt: Count
    version: Count
    time_ns: Natural


class CertificateLife(Message):
    """From when to when a service's certificates are good, unix seconds."""

    start_unix_s: UnixTime
    end_unix_s: UnixTime


class Telemetry(Message):
    """How a service is.

    Attributes:
        kind: learner, edge, robot_sim, dashboard.
        run: the run that it works on, if any; `slot` likewise.
        host: name of its machine.
        clock: names what its monotonic clock counts from: monotonic times of two services can be compared
            only if these are equal.
        time_ns: unix time of this report.
        waiting_for: None if it is not waiting.
        cpu_percent: of one core, since the report before.
        rss_bytes: resident memory.
        latencies: of the last seconds, by name (docs/metrics.md).
        refusals: by counter, why the newest of what it counts was refused.
        version, protocol: of the program (`bpn_shared.version`); empty and 1 of one that did not tell.
        certificate: of its certificates on the bus, the life of the one to renew first; None: it has none.
    """

    SCHEMA = 3
    OLDER_SCHEMAS = frozenset({1, 2})

    kind: Kind
    worker: WorkerId
    run: Annotated[str, Field(pattern=r"^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$")] | None
    slot: Count | None
    host: Text
    clock: Text
    pid: Natural
    time_ns: Natural
    uptime_s: NotNegative
    waiting_for: Reason | None
    waiting_s: NotNegative
    cpu_percent: NotNegative
    rss_bytes: Natural
    counters: Annotated[dict[Name, Natural], Field(max_length=200)]
    weights: dict[WeightsEvent, WeightsMark]
    latencies: Annotated[dict[Name, Percentiles], Field(max_length=50)]
    traffic: Annotated[list[KeyTraffic], Field(max_length=128)]
    refusals: Annotated[dict[Name, Reason], Field(max_length=20)] = Field(default_factory=dict)
    version: Version = ""
    protocol: Count = 1
    certificate: CertificateLife | None = None
