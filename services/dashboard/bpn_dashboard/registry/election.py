"""Which of the dashboards on a router serves its workers: one does, the others only show.

Who serves holds a token on the bus. Others that see it wait, and the first to miss it takes over. Two that began
at once, or met when two networks were joined, see each other: the one whose key comes first goes on.
"""

import logging
import os
import platform
import re
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import Token, TokenWatch
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters

log = logging.getLogger(__name__)

SETTLE_S = 1.5
"""After the router was reached: until then tokens may be on their way."""
MISSED_S = 5.0
"""After the token of who served has gone: its connection may come back."""
_PERIOD_S = 0.25


class Rival(NamedTuple):
    """Another dashboard that serves this router."""

    host: str
    pid: str

    def __str__(self) -> str:
        return f"another dashboard ({self.host}, pid {self.pid}) serves this router: read-only"


class Election:
    """One candidate's view. Times are seconds of any clock that does not jump; not thread-safe.

    Args:
        key: of its own token.
        now_s: when it reached the router.
    """

    def __init__(self, key: str, now_s: float) -> None:
        self._key = key
        self._others: set[str] = set()
        self._free_from_s = now_s + SETTLE_S
        self.serves = False

    def token(self, key: str, appeared: bool, now_s: float) -> None:
        """Somebody's token came or went."""
        if key == self._key:
            return
        if appeared:
            self._others.add(key)
        elif key in self._others:
            self._others.remove(key)
            self._free_from_s = max(self._free_from_s, now_s + MISSED_S)

    def reconnected(self, now_s: float) -> None:
        """The router was reached again; others may take a little longer."""
        self._free_from_s = max(self._free_from_s, now_s + MISSED_S)

    def decide(self, now_s: float, *, connected: bool = True) -> bool:
        """Whether to serve from now on; who does not reach the router sees nobody, and does not begin to."""
        if self.serves:
            self.serves = all(self._key < other for other in self._others)
        else:
            self.serves = connected and not self._others and now_s >= self._free_from_s
        return self.serves

    @property
    def settled(self) -> bool:
        """Whether it is known who serves."""
        return self.serves or bool(self._others)

    @property
    def rival(self) -> Rival | None:
        """Who serves instead."""
        if self.serves or not self._others:
            return None
        *_, host, pid, _ = min(self._others).split("/")
        return Rival(host, pid)


class Candidate:
    """Takes part in the election from a thread of its own, until it is closed.

    Args:
        name: of this life of the dashboard.
        lead: is told whether to serve, on the thread; where it raises, again.
        counters: what fails is counted here.
    """

    def __init__(
        self, bus: Bus, name: str, lead: Callable[[bool], None], counters: Counters
    ) -> None:
        self._bus, self._lead, self._counters = bus, lead, counters
        host = re.sub(r"[^A-Za-z0-9_.-]", "-", platform.node()) or "unknown"
        self._key = keys.serving(host, str(os.getpid()), name)
        self._news = threading.Condition()
        self._election = Election(self._key, time.monotonic())
        self._token: Token | None = None
        self._leads = False  # that is, `lead` has heard so
        self._router = bus.router
        self._closed = threading.Event()
        self._watch = TokenWatch(bus, keys.serving("*", "*", "*"), self._on_token)
        self._thread = threading.Thread(target=self._run, name="election", daemon=True)
        self._thread.start()

    @property
    def serves(self) -> bool:
        """Whether this one serves the router."""
        with self._news:
            return self._election.serves

    @property
    def rival(self) -> Rival | None:
        """Who serves instead."""
        with self._news:
            return self._election.rival

    @property
    def settled(self) -> bool:
        """Whether it is known who serves."""
        with self._news:
            return self._election.settled

    def wait_settled(self, timeout_s: float) -> None:
        """Returns as soon as it is known who serves, this one takes part no more, or the time is over."""
        with self._news:
            self._news.wait_for(lambda: self._election.settled or self._closed.is_set(), timeout_s)

    def close(self) -> None:
        """Takes part no more; the token goes with the session."""
        with self._news:
            self._closed.set()
            self._news.notify_all()
        self._thread.join()
        self._watch.close()

    def _on_token(self, key: str, appeared: bool) -> None:
        with self._news:
            self._election.token(key, appeared, time.monotonic())
            self._news.notify_all()

    def _run(self) -> None:
        while not self._closed.wait(_PERIOD_S):
            try:
                self._decide()
            except Exception as error:
                self._counters.fault(
                    "elections_failed", "the election of who serves the router", error
                )

    def _decide(self) -> None:
        with self._news:
            if (router := self._bus.router) != self._router:
                self._router = router
                self._election.reconnected(time.monotonic())
            serves = self._election.decide(time.monotonic(), connected=self._bus.connected)
            rival = self._election.rival
            self._news.notify_all()
        if serves == self._leads:
            return
        if serves and self._token is None:
            self._token = Token(self._bus, self._key)
            log.info("serves the workers of the router at %s", self._bus.endpoint)
        if not serves and self._token is not None:
            self._token.close()
            self._token = None
            log.warning("%s", rival)
        self._lead(serves)
        self._leads = serves
