"""Tells workers to let go of their places, beside the registry's rounds: one that is frozen delays nobody."""

import time
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor

from bpn_dashboard.registry.leases import Place
from bpn_shared.bus import keys
from bpn_shared.bus.requests import NoReplyError, RefusedError, request
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.lease import Release

_TIMEOUT_S = 1.0
_AGAIN_S = 1.0
_AT_ONCE = 8


class Releases:
    """Tells each again every second until it is told no more.

    Args:
        counters: what goes wrong is counted here.
    """

    def __init__(self, bus: Bus, counters: Counters) -> None:
        self._bus, self._counters = bus, counters
        self._pool = ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="release")
        self._told: dict[tuple[Place, str], tuple[float, Future[None]]] = {}

    def tell(self, leases: Iterable[tuple[Place, str, str]]) -> None:
        """Tells these workers, and only these, to let go: place, worker, reason."""
        now_s = time.monotonic()
        told, self._told = self._told, {}
        for place, worker, reason in leases:
            at_s, sent = told.get((place, worker), (-_AGAIN_S, None))
            if sent is None or (sent.done() and now_s - at_s >= _AGAIN_S):
                at_s, sent = now_s, self._pool.submit(self._release, place, worker, reason)
            self._told[place, worker] = at_s, sent

    def _release(self, place: Place, worker: str, reason: str) -> None:
        body = Release(run=str(place.run), reason=reason).encode()
        try:
            request(self._bus, keys.control(place.role, worker), body, timeout_s=_TIMEOUT_S)
        except (NoReplyError, RefusedError) as error:
            said = f"{worker} does not let go of run {place.run}: {error}"
            self._counters.refuse("releases_unanswered", said)
        except Exception as error:
            self._counters.fault("releases_failed", "telling workers to let go", error)

    def close(self) -> None:
        """Tells nobody any more."""
        self._pool.shutdown(wait=True, cancel_futures=True)
