"""Who is alive: a token that goes with its process, within milliseconds of a crash."""

import threading
from collections.abc import Callable

import zenoh

from bpn_shared.bus import keys
from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus


class Token(Declared):
    """Stands at a key."""

    def __init__(self, bus: Bus, key: str) -> None:
        super().__init__()
        self._keep(bus.zenoh.liveliness().declare_token(key))


class AliveToken(Token):
    """Says that this worker is alive."""

    def __init__(self, bus: Bus, kind: str, worker: str) -> None:
        super().__init__(bus, keys.live(kind, worker))


OnToken = Callable[[str, bool], None]
"""Takes a token's key, and whether it has appeared (or has gone). It must be quick."""


class TokenWatch(Declared):
    """Calls `on_token` for every token that matches a key expression, on a thread of its own.

    Tokens that stand already are told soon after the beginning.
    """

    def __init__(self, bus: Bus, pattern: str, on_token: OnToken) -> None:
        super().__init__()

        def changed(token: zenoh.Sample) -> None:
            on_token(str(token.key_expr), token.kind == zenoh.SampleKind.PUT)

        self._keep(bus.zenoh.liveliness().declare_subscriber(pattern, changed, history=True))


class Alive:
    """The workers of one kind that are alive now."""

    def __init__(self, bus: Bus, kind: str) -> None:
        self._lock = threading.Lock()
        self._workers: set[str] = set()
        self._watch = TokenWatch(bus, keys.live(kind, "*"), self._changed)

    def _changed(self, key: str, alive: bool) -> None:
        _, worker = keys.worker_of(key)
        with self._lock:
            if alive:
                self._workers.add(worker)
            else:
                self._workers.discard(worker)

    def close(self) -> None:
        """Looks no more; `workers` stays as it is."""
        self._watch.close()

    def workers(self) -> set[str]:
        """Their ids."""
        with self._lock:
            return set(self._workers)

    def __contains__(self, worker: object) -> bool:
        with self._lock:
            return worker in self._workers
