"""Who is alive: a token that goes with its process, within milliseconds of a crash."""

import threading

import zenoh

from bpn_shared import keys
from bpn_shared.bus.session import Bus


class AliveToken:
    """Says that this worker is alive, until the session ends."""

    def __init__(self, bus: Bus, kind: str, worker: str) -> None:
        self._token = bus.zenoh.liveliness().declare_token(keys.live(kind, worker))


class Alive:
    """The workers of one kind that are alive now."""

    def __init__(self, bus: Bus, kind: str) -> None:
        self._lock = threading.Lock()
        self._workers: set[str] = set()
        self._subscriber = bus.zenoh.liveliness().declare_subscriber(
            keys.live(kind, "*"), self._changed, history=True
        )

    def _changed(self, token: zenoh.Sample) -> None:
        worker = str(token.key_expr).rsplit("/", 1)[-1]
        with self._lock:
            if token.kind == zenoh.SampleKind.PUT:
                self._workers.add(worker)
            else:
                self._workers.discard(worker)

    def workers(self) -> set[str]:
        """Their ids."""
        with self._lock:
            return set(self._workers)

    def __contains__(self, worker: object) -> bool:
        with self._lock:
            return worker in self._workers
