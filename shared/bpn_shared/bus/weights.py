"""Weights: published to those who listen, kept for those who come later; the highest (attempt, version) wins."""

import logging
import struct
import threading
from collections.abc import Callable
from uuid import UUID

import zenoh

from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.weights import (
    Rank,
    Weights,
    decode_weights,
    max_weights_bytes,
    network_kind,
    rank_of,
)
from bpn_shared.bus import keys
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.spec.algorithms import NetworkKind
from bpn_shared.spec.network import NetworkSpec

log = logging.getLogger(__name__)

_HEADER = struct.Struct("<BII")
_SCHEMA = 1
_GET_TIMEOUT_S = 2.0


def _encode_header(weights: Weights) -> bytes:
    return _HEADER.pack(_SCHEMA, weights.attempt, weights.version)


class WeightsPublisher:
    """Publishes a run's weights and answers with the newest."""

    def __init__(self, bus: Bus, run: UUID) -> None:
        self._key = keys.weights(run)
        self._sent = bus.traffic.sent(self._key)
        self._newest: tuple[bytes, bytes] | None = None
        self._publisher = bus.zenoh.declare_publisher(
            self._key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA_LOW,
        )
        self._queryable = bus.zenoh.declare_queryable(self._key, self._answer, complete=True)

    def publish(self, weights: Weights) -> None:
        header, data = _encode_header(weights), weights.encode()
        self._newest = header, data
        self._publisher.put(data, attachment=header)
        self._sent.add(len(data))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            if self._newest is not None:
                header, data = self._newest
                query.reply(self._key, data, attachment=header)


class WeightsSubscriber:
    """Hands on every policy that is newer than what its taker holds.

    Subscribes first and asks for the newest afterwards, so nothing falls between; asks again whenever a
    learner appears and whenever `refresh` is called. It keeps no note of its own of what it handed on: a policy
    that was not taken, or that was lost since, is handed on again.

    Args:
        spec: geometry that the policies must have.
        on_newer: called with each such policy, on a network thread: it must be quick.
        counters: `weights_refused` is counted here.
        held: the rank of the newest policy that `on_newer` took and that is still there.
        kind: of network that they must be for.
    """

    def __init__(
        self,
        bus: Bus,
        run: UUID,
        spec: NetworkSpec,
        on_newer: Callable[[Weights], object],
        counters: Counters,
        *,
        held: Callable[[], Rank],
        kind: NetworkKind,
    ) -> None:
        self._bus, self._run, self._spec, self._kind = bus, run, spec, kind
        self._on_newer = on_newer
        self._counters = counters
        self._lock = threading.Lock()
        self._held = held
        self._received = bus.traffic.received(keys.weights(run))
        self._subscriber = bus.zenoh.declare_subscriber(keys.weights(run), self._receive)
        self._learners = bus.zenoh.liveliness().declare_subscriber(
            keys.live("learner", "*"), self._learner_changed, history=True
        )
        self.refresh()

    def refresh(self) -> None:
        """Asks for the newest weights; returns when the answer was handed on or nobody answers."""
        for reply in self._bus.zenoh.get(
            keys.weights(self._run),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_GET_TIMEOUT_S,
        ):
            if reply.ok is not None:
                self._receive(reply.ok)

    def _learner_changed(self, token: zenoh.Sample) -> None:
        if token.kind == zenoh.SampleKind.PUT:
            self.refresh()

    def _receive(self, sample: zenoh.Sample) -> None:
        header = sample.attachment.to_bytes() if sample.attachment is not None else b""
        try:
            with self._lock:
                rank = _decode_rank(header)
                if rank <= self._held():
                    return
                data = sample.payload.to_bytes()
                self._received.add(len(data))
                self._on_newer(self._decode(data, rank))
        except BlobError as error:
            self._counters.refuse("weights_refused", f"weights refused: {error}")

    def _decode(self, data: bytes, rank: Rank) -> Weights:
        limit = max_weights_bytes(self._kind, self._spec)
        if len(data) > limit:
            raise BlobError(
                f"{len(data)} bytes, a {self._kind} policy with {self._spec} has {limit}"
            )
        weights = decode_weights(data)
        if network_kind(weights) != self._kind:
            raise BlobError(f"a {network_kind(weights)} policy, this edge runs {self._kind} ones")
        if weights.spec != self._spec:
            raise BlobError(f"geometry {weights.spec}, this edge runs {self._spec}")
        if weights.run != self._run:
            raise BlobError(f"belongs to run {weights.run}, this edge serves {self._run}")
        if rank_of(weights) != rank:
            raise BlobError(f"header says (attempt, version) {rank}, the policy says otherwise")
        return weights


def _decode_rank(header: bytes) -> Rank:
    if len(header) != _HEADER.size:
        raise BlobError(f"header of {len(header)} bytes, expected {_HEADER.size}")
    schema, attempt, version = _HEADER.unpack(header)
    if schema != _SCHEMA:
        raise BlobError(f"header schema {schema}, this program reads {_SCHEMA}")
    return attempt, version
