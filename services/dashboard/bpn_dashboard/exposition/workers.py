"""Workers: how many of which kind, what is missing, what they refused, and how each one is."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal, get_args

from prometheus_client.metrics_core import Metric

from bpn_dashboard.exposition.families import counter, gauge
from bpn_dashboard.hub.presence import KIND as DASHBOARD
from bpn_dashboard.hub.refusals import refusals
from bpn_dashboard.hub.topology import Node
from bpn_dashboard.registry.versions import Refused
from bpn_dashboard.registry.view import RegistryView
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import Role

MOST_WORKERS = 1000
"""That have samples of their own; all are counted."""
KINDS: tuple[Role, ...] = get_args(Role)
_State = Literal["idle", "working", "silent"]
_LABELS = ("kind", "worker")
_OF_EACH: tuple[tuple[str, str, Callable[[Node], float]], ...] = (
    ("bpn_worker_report_age_seconds", "Since its last report; it reports every second.",
     lambda node: node.age_s or 0.0),
    ("bpn_worker_waiting_seconds", "For how long it has waited for something; 0: it does not.",
     lambda node: node.waiting_s),
    ("bpn_worker_resident_memory_bytes", "Resident memory.", lambda node: node.rss_bytes or 0),
)  # fmt: skip


def collect(
    nodes: Sequence[Node],
    refused: Sequence[Refused],
    refusals_by_kind: Mapping[str, int],
    view: RegistryView,
    own: Counters,
) -> Iterator[Metric]:
    """The families of workers.

    Args:
        nodes: all services that are known.
        refused: workers that ask for work and cannot be used.
        refusals_by_kind: how much workers have refused.
        own: what the dashboard counts.
    """
    useless = {worker.worker for worker in refused}
    there = [n for n in nodes if n.kind in KINDS and n.state != "dead"]
    useful = Counter((node.kind, _state(node)) for node in there if node.id not in useless)
    yield gauge(
        "bpn_workers", "Workers that can be used.", ["kind", "state"],
        [((kind, s), useful[kind, s]) for kind in KINDS for s in get_args(_State)],
    )  # fmt: skip
    yield gauge(
        "bpn_workers_refused", "Workers that ask for work and cannot be used.", [],
        [((), len(refused))],
    )  # fmt: skip
    yield gauge(
        "bpn_places_vacant", "Places in wanted runs that nobody has.", ["kind"],
        [((kind,), view.vacant.get(kind, 0)) for kind in KINDS],
    )  # fmt: skip
    ours = sum(refusals(own.snapshot(), own.reasons()).values())
    totals = {kind: refusals_by_kind.get(kind, 0) for kind in KINDS} | {DASHBOARD: ours}
    yield counter(
        "bpn_refusals", "What services refused or could not do, by their kind.", ["kind"],
        [((kind,), total) for kind, total in totals.items()],
    )  # fmt: skip
    yield from _single_workers(there[:MOST_WORKERS])


def _single_workers(nodes: list[Node]) -> Iterator[Metric]:
    heard = [(node, (node.kind, node.id)) for node in nodes if node.age_s is not None]
    yield gauge(
        "bpn_worker_info", "1: where it runs, which program, and for which run.",
        [*_LABELS, "host", "version", "protocol", "run", "slot"],
        [
            ((*labels, node.host, node.version, _text(node.protocol), _text(node.run), _text(node.slot)), 1)
            for node, labels in heard
        ],
    )  # fmt: skip
    for name, meaning, value in _OF_EACH:
        yield gauge(name, meaning, _LABELS, [(labels, value(node)) for node, labels in heard])
    yield counter(
        "bpn_worker_refusals", "What it refused or could not do, by its own counter.",
        [*_LABELS, "counter"],
        [
            ((*labels, name), count)
            for node, labels in heard
            for name, count in sorted(refusals(node.counters, node.refusals).items())
        ],
    )  # fmt: skip


def _state(node: Node) -> _State:
    if node.state != "live":
        return "silent"
    return "idle" if node.run is None else "working"


def _text(value: object) -> str:
    """A label's value; without one the label is missing."""
    return "" if value is None else str(value)
