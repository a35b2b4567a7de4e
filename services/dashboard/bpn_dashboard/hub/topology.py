"""Who is alive, what each does and waits for, and what flows between them: from tokens and telemetry.

Fed from the network's threads, asked from any. Ages are on this process's clock.
"""

import re
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

from pydantic import BaseModel, ConfigDict

from bpn_dashboard.hub.refusals import RefusalTotals
from bpn_shared.bus import keys
from bpn_shared.bus.access import CHANNELS
from bpn_shared.messages.telemetry import (
    CertificateLife,
    KeyTraffic,
    Percentiles,
    Telemetry,
    WeightsEvent,
)

STALE_AFTER_S = 3.0
"""Without a report for so long a service is stale: it may hang."""
DEAD_AFTER_S = 10.0
"""Without a report and a token it is dead; with a token that went it is dead at once."""
FORGET_AFTER_S = 60.0
_KEPT_LOADS = 20

NodeState = Literal["live", "stale", "dead"]
_RUN_OF_KEY = re.compile(r"bpn/([0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12})/")


def _requests() -> frozenset[str]:
    """The last parts of the keys at which only requests travel."""
    names: dict[str, set[str]] = {"request": set(), "stream": set(), "token": set()}
    for channel in CHANNELS:
        names[channel.way].add(channel.key.rsplit("/", 1)[-1])
    return frozenset(names["request"] - names["stream"])


_REQUESTS = _requests()


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class Latency(_Model):
    """Of the last seconds, microseconds.

    Attributes:
        uncertainty_us: 0 where one clock measured it; else half of the way there and back, because the
            clocks of two machines cannot tell the directions apart.
    """

    count: int
    p50_us: float
    p95_us: float
    p99_us: float
    uncertainty_us: float = 0.0


class Weights(_Model):
    """Weights that a service published, loaded, or runs."""

    attempt: int
    version: int
    time_unix_s: float


class Flow(_Model):
    """What a service sends or receives at one key: totals, and rates between its last two reports."""

    key: str
    direction: Literal["sent", "received"]
    messages: int
    bytes: int
    dropped: int
    messages_per_s: float
    bytes_per_s: float
    dropped_per_s: float


class Node(_Model):
    """One service. Values are of its last report; those who never reported have none.

    Attributes:
        age_s: since the last report; None before the first.
        waiting_s: how long it has waited, as of now.
        refusals: by counter, why the newest of what it counts was refused.
        version, protocol: of its program.
        certificate: the life of the one with which it reaches the router.
    """

    kind: str
    id: str
    state: NodeState
    age_s: float | None
    run: str | None = None
    slot: int | None = None
    host: str = ""
    pid: int | None = None
    uptime_s: float | None = None
    waiting_for: str | None = None
    waiting_s: float = 0.0
    cpu_percent: float | None = None
    rss_bytes: int | None = None
    counters: dict[str, int] = {}
    refusals: dict[str, str] = {}
    version: str = ""
    protocol: int | None = None
    certificate: CertificateLife | None = None
    weights: dict[WeightsEvent, Weights] = {}
    latencies: dict[str, Percentiles] = {}
    flows: list[Flow] = []


class Link(_Model):
    """What flows from one service to another.

    Attributes:
        topic: the last part of the key: frame, action, weights ...
        dropped: by the receiver's newest-only slot; of requests: not answered in time.
        latency: one way; of weights: from publishing to loaded and verified.
    """

    source: str
    target: str
    topic: str
    form: Literal["stream", "request"]
    key: str
    run: str | None
    messages: int
    messages_per_s: float
    bytes_per_s: float
    dropped: int
    dropped_per_s: float
    latency: Latency | None


class TopologySnapshot(_Model):
    """Everything at one moment."""

    time_unix_s: float
    nodes: list[Node]
    links: list[Link]


@dataclass
class _Known:
    kind: str
    id: str
    token: bool | None = None
    """None: never seen."""
    changed_s: float = 0.0
    heard_s: float | None = None
    report: Telemetry | None = None
    flows: list[Flow] = field(default_factory=list)
    loads_us: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_LOADS))
    last_load: tuple[int, int] | None = None

    def state(self, now_s: float) -> NodeState:
        if self.token is False:
            return "dead"
        if self.heard_s is None:
            return "live" if now_s - self.changed_s <= STALE_AFTER_S else "stale"
        age_s = now_s - self.heard_s
        if age_s <= STALE_AFTER_S:
            return "live"
        return "stale" if self.token or age_s <= DEAD_AFTER_S else "dead"

    def last_sign_s(self) -> float:
        return max(self.changed_s, self.heard_s or 0.0)


class Topology:
    """Keeps what is known of every service.

    Args:
        now_s: monotonic clock, for tests.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._known: dict[tuple[str, str], _Known] = {}
        self._refusals = RefusalTotals()

    def token(self, key: str, alive: bool) -> None:
        """The liveliness token at this key appeared or went."""
        with self._lock:
            known = self._of(*keys.worker_of(key))
            known.token, known.changed_s = alive, self._now_s()

    def hear(self, report: Telemetry) -> None:
        """A report came."""
        with self._lock:
            known = self._of(report.kind, report.worker)
            known.flows = list(_flows(known.report, report))
            self._refusals.take(known.report, report)
            known.report, known.heard_s = report, self._now_s()
            self._note_loads(report.run)

    def _of(self, kind: str, worker: str) -> _Known:
        return self._known.setdefault((kind, worker), _Known(kind, worker))

    def _note_loads(self, run: str | None) -> None:
        """Measures publishing to loading wherever both reports are of the same weights."""
        members = [k for k in self._known.values() if k.report is not None and k.report.run == run]
        marks = [k.report.weights.get("published") for k in members if k.report is not None]
        published = {(m.attempt, m.version): m.time_ns for m in marks if m is not None}
        for known in members:
            assert known.report is not None
            loaded = known.report.weights.get("loaded")
            if loaded is None:
                continue
            rank = loaded.attempt, loaded.version
            published_ns = published.get(rank)
            started_ns = known.report.time_ns - known.report.uptime_s * 1e9
            # what was published before the service began waited for it, not on the way
            if rank != known.last_load and published_ns is not None and published_ns > started_ns:
                known.last_load = rank
                known.loads_us.append((loaded.time_ns - published_ns) / 1e3)

    def refusals(self) -> dict[str, int]:
        """How much services have refused, by their kind."""
        with self._lock:
            return self._refusals.by_kind()

    def snapshot(self) -> TopologySnapshot:
        """Nodes sorted by run, slot and kind; links between those that are not dead."""
        now_s = self._now_s()
        with self._lock:
            self._forget(now_s)
            known = list(self._known.values())
            nodes = [_node(each, now_s) for each in known]
            there = [k for k in known if k.report is not None and k.state(now_s) != "dead"]
            links = list(_links(there))
        nodes.sort(key=lambda n: (n.run or "", -1 if n.slot is None else n.slot, n.kind, n.id))
        return TopologySnapshot(time_unix_s=time.time(), nodes=nodes, links=links)

    def _forget(self, now_s: float) -> None:
        for name, known in tuple(self._known.items()):
            if known.state(now_s) == "dead" and now_s - known.last_sign_s() > FORGET_AFTER_S:
                del self._known[name]


def _flows(before: Telemetry | None, now: Telemetry) -> Iterator[Flow]:
    """Of keys that are of no run or of the present one: a worker's tallies outlive its leases."""
    totals = {(t.key, t.direction): t for t in before.traffic} if before is not None else {}
    seconds = (now.time_ns - before.time_ns) / 1e9 if before is not None else 0.0
    for total in now.traffic:
        run = _RUN_OF_KEY.match(total.key)
        if run is not None and run[1] != now.run:
            continue
        last = totals.get((total.key, total.direction)) or _nothing(total)
        yield Flow(
            **total.model_dump(),
            messages_per_s=_rate(total.messages - last.messages, seconds),
            bytes_per_s=_rate(total.bytes - last.bytes, seconds),
            dropped_per_s=_rate(total.dropped - last.dropped, seconds),
        )


def _nothing(total: KeyTraffic) -> KeyTraffic:
    return KeyTraffic(key=total.key, direction=total.direction, messages=0, bytes=0, dropped=0)


def _rate(count: int, seconds: float) -> float:
    return round(max(0, count) / seconds, 2) if seconds > 0 else 0.0


def _node(known: _Known, now_s: float) -> Node:
    state, report = known.state(now_s), known.report
    if report is None or known.heard_s is None:
        return Node(kind=known.kind, id=known.id, state=state, age_s=None)
    age_s = now_s - known.heard_s
    return Node(
        kind=known.kind,
        id=known.id,
        state=state,
        age_s=round(age_s, 3),
        **report.model_dump(
            include={
                "run", "slot", "host", "pid", "uptime_s", "waiting_for", "cpu_percent", "rss_bytes", "counters",
                "refusals", "version", "protocol", "certificate",
            }
        ),
        waiting_s=round(report.waiting_s + age_s, 3) if report.waiting_for else 0.0,
        weights={
            event: Weights(attempt=m.attempt, version=m.version, time_unix_s=m.time_ns / 1e9)
            for event, m in report.weights.items()
        },
        latencies=report.latencies,
        flows=known.flows,
    )  # fmt: skip


def _links(known: list[_Known]) -> Iterator[Link]:
    receivers: dict[str, list[tuple[_Known, Flow]]] = {}
    for each in known:
        for flow in each.flows:
            if flow.direction == "received":
                receivers.setdefault(flow.key, []).append((each, flow))
    for source in known:
        for sent in source.flows:
            if sent.direction == "sent":
                for target, received in receivers.get(sent.key, ()):
                    yield _link(source, sent, target, received)


def _link(source: _Known, sent: Flow, target: _Known, received: Flow) -> Link:
    topic = sent.key.rsplit("/", 1)[-1]
    request = topic in _REQUESTS
    losses = sent if request else received
    assert source.report is not None
    assert target.report is not None
    return Link(
        source=source.id,
        target=target.id,
        topic=topic,
        form="request" if request else "stream",
        key=sent.key,
        run=source.report.run,
        messages=sent.messages,
        messages_per_s=sent.messages_per_s,
        bytes_per_s=sent.bytes_per_s,
        dropped=losses.dropped,
        dropped_per_s=losses.dropped_per_s,
        latency=_latency(topic, source, target),
    )


def _latency(topic: str, source: _Known, target: _Known) -> Latency | None:
    """Edges measure both hops between them and their robots; weights are compared by their marks."""
    assert source.report is not None
    assert target.report is not None
    one_clock = source.report.clock == target.report.clock
    if topic == "weights":
        return _load_latency(target, one_clock)
    edge = {"frame": target, "action": source}.get(topic)
    if edge is None or edge.report is None:
        return None
    hop = {"frame": "camera_to_edge_us", "action": "action_to_robot_us"}[topic]
    measured = edge.report.latencies.get(hop if one_clock else "bus_us")
    if measured is None:
        return None
    share = 1.0 if one_clock else 0.5
    return Latency(
        count=measured.count,
        p50_us=measured.p50_us * share,
        p95_us=measured.p95_us * share,
        p99_us=measured.p99_us * share,
        uncertainty_us=0.0 if one_clock else measured.p50_us * share,
    )


def _load_latency(edge: _Known, one_clock: bool) -> Latency | None:
    if not edge.loads_us or not one_clock:
        return None
    loads_us = sorted(edge.loads_us)
    return Latency(
        count=len(loads_us),
        p50_us=round(statistics.median(loads_us), 1),
        p95_us=round(loads_us[round(0.95 * (len(loads_us) - 1))], 1),
        p99_us=round(loads_us[-1], 1),
    )
