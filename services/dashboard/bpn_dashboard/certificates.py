"""Certificates and their ends: the dashboard's own, the router's as it shows it, those that workers tell of."""

import logging
import threading
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from bpn_dashboard.hub.topology import TopologySnapshot
from bpn_shared.bus.certificates import own_certificates
from bpn_shared.bus.obstacle import router_certificate
from bpn_shared.bus.renewal import CertificateWatch
from bpn_shared.bus.x509 import Life, facts_of

log = logging.getLogger(__name__)

_LOOK_S = 10.0
_ROUTER_EVERY = 6
"""Looks at our own files for one at the router, which is a connection."""


class Certificate(NamedTuple):
    """Whose certificate it is, and from when to when it is good.

    Attributes:
        kind: of the service; router: as it shows it, web: of the pages' address.
        id: of the worker; empty where there is one of the kind.
    """

    kind: str
    id: str
    life: Life

    def days_left(self, now: datetime) -> float:
        """Below 0: it has expired."""
        return self.life.left(now) / timedelta(days=1)


class OwnCertificates:
    """Looks at them from a thread of its own, and says in the log when the dashboard's is near its end.

    Args:
        endpoint: the router's.
        web: the certificate of the pages' address, if the dashboard shows one.
    """

    def __init__(self, endpoint: str, web: Path | None = None) -> None:
        self._endpoint, self._web = endpoint, web
        files = own_certificates() if endpoint.startswith("tls/") else None
        self._watch = None if files is None else CertificateWatch(files)
        self._router: Life | None = None
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="certificates", daemon=True)

    def start(self) -> None:
        """Begins, unless there are none."""
        if self._watch is not None:
            self._thread.start()

    def close(self) -> None:
        """Looks no more."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        looks = 0
        while not self._closed.is_set():
            try:
                self._look(at_router=looks % _ROUTER_EVERY == 0 or self._router is None)
            except Exception:
                log.exception("looking at the certificates failed")
            looks += 1
            self._closed.wait(_LOOK_S)

    def _look(self, *, at_router: bool) -> None:
        assert self._watch is not None
        self._watch.warn()
        if at_router and (shown := router_certificate(self._endpoint)) is not None:
            self._router = shown.life

    def current(self) -> list[Certificate]:
        """As they were at the last look."""
        lives = {
            "dashboard": None if self._watch is None else self._watch.life,
            "router": self._router,
            "web": self._web_life(),
        }
        return [Certificate(kind, "", life) for kind, life in lives.items() if life is not None]

    def _web_life(self) -> Life | None:
        if self._web is not None:
            with suppress(OSError, ValueError):  # in the middle of being replaced
                return facts_of(self._web).life
        return None


def of_workers(topology: TopologySnapshot) -> Iterator[Certificate]:
    """Those of which the workers that live tell."""
    for node in topology.nodes:
        told = node.certificate
        if told is not None and node.state != "dead":
            start, end = (
                datetime.fromtimestamp(t, UTC) for t in (told.start_unix_s, told.end_unix_s)
            )
            yield Certificate(node.kind, node.id, Life(start, end))
