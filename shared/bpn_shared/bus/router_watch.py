"""Says when the router is lost, why, and when it is back; and tells those who may not hold on for longer."""

import contextlib
import logging
import threading
import time
from collections.abc import Iterator

from bpn_shared.backoff import Backoff
from bpn_shared.bus.certificates import own_certificates
from bpn_shared.bus.obstacle import obstacle
from bpn_shared.bus.renewal import CertificateWatch
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.bus.x509 import Life
from bpn_shared.closing import Closing
from bpn_shared.counters import Counters
from bpn_shared.waiting import WaitStatus

log = logging.getLogger(__name__)

PERIOD_S = 1.0
SAY_AFTER_S = 2.0
"""A router that is restarted is back sooner, and nobody needs to know."""
STOOD_STILL_S = 5.0
"""Looks further apart than this are no busy machine any more: the process or its machine was frozen."""
GIVE_UP_AFTER_S = 30.0
"""How long who owns what others could take over holds on to it without a router."""


class RouterLostError(BusError):
    """The router was lost for so long that the work here was given up, so that others can go on with it."""


def now_s() -> float:
    """A clock that goes on while this machine sleeps or this process is frozen, seconds."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Outage:
    """For how long the router has been lost, as one who looks from time to time knows it.

    Time in which nobody looked counts as lost: a process that was frozen, or its machine, has no session any more,
    whatever the session says at first.
    """

    def __init__(self, t_s: float) -> None:
        self._seen_s = self._looked_s = t_s
        self.stood_still_s = 0.0
        """How long nobody looked before the last look, if that was for too long; else 0."""

    def look(self, connected: bool, t_s: float) -> float:
        """Notes what is at time `t_s`; returns for how long the router had been lost until now, seconds."""
        gap_s, self._looked_s = t_s - self._looked_s, t_s
        self.stood_still_s = gap_s if gap_s > STOOD_STILL_S else 0.0
        lost_s = t_s - self._seen_s
        if connected:
            self._seen_s = t_s
            return self.stood_still_s
        return lost_s


class RouterWatch(Closing):
    """Looks once a second whether a session has its router, from a thread of its own.

    Args:
        waiting: is told that nothing goes on without the router.
        counters: `router_lost` is counted here.
        say_after_s: for how long it must be lost before that is said.
        certificates: whether it says as well when the session's certificates are near their end.

    Attributes:
        why: it is lost, where that is known; empty: it is not, or nobody can say why.
    """

    def __init__(
        self,
        bus: Bus,
        waiting: WaitStatus,
        counters: Counters,
        *,
        period_s: float = PERIOD_S,
        say_after_s: float = SAY_AFTER_S,
        certificates: bool = True,
    ) -> None:
        self._bus, self._waiting, self._counters = bus, waiting, counters
        self._period_s, self._say_after_s = period_s, say_after_s
        self._outage = Outage(now_s())
        self._lock = threading.Lock()
        self._holders: dict[threading.Event, tuple[float, list[str]]] = {}
        files = own_certificates() if certificates else None
        self._certificate = None if files is None else CertificateWatch(files)
        self._said: str | None = None
        self.why = ""
        self._backoff = Backoff(2.0, 60.0)
        self._look_why_s = 0.0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="router watch", daemon=True)
        self._thread.start()

    @property
    def certificate(self) -> Life | None:
        """For how long the certificates of this worker, or its machine's router, are good; None: none."""
        return None if self._certificate is None else self._certificate.life

    @contextlib.contextmanager
    def holding_for(self, after_s: float, stop: threading.Event) -> Iterator[None]:
        """Sets `stop` if the router is lost for longer while the body runs, which then ends the work.

        Raises:
            RouterLostError: that happened.
        """
        reasons: list[str] = []
        with self._lock:
            self._holders[stop] = after_s, reasons
        try:
            yield
        finally:
            with self._lock:
                self._holders.pop(stop, None)
        if reasons:
            raise RouterLostError(reasons[0])

    def _watch(self) -> None:
        while not self._closed.wait(self._period_s):
            try:
                self._look()
            except Exception as error:
                self._counters.fault("router_watch_failed", "watching the router", error)

    def _look(self) -> None:
        if self._certificate is not None:
            self._certificate.warn()
        connected, t_s = self._bus.connected, now_s()
        lost_s = self._outage.look(connected, t_s)
        if self._outage.stood_still_s:
            log.warning("this process stood still for %.0f s", self._outage.stood_still_s)
        self._give_up(lost_s)
        if connected:
            if self._said is not None:
                self._found()
        elif lost_s >= self._say_after_s:
            self._lost(lost_s, t_s)

    def _give_up(self, lost_s: float) -> None:
        with self._lock:
            for stop, (after_s, reasons) in self._holders.items():
                if lost_s > after_s and not stop.is_set():
                    reasons.append(
                        f"this process stood still for {lost_s:.0f} s"
                        if self._outage.stood_still_s
                        else f"the router at {self._bus.endpoint} is lost for {lost_s:.0f} s"
                        + (f": {self.why}" if self.why else "")
                    )
                    stop.set()

    def _lost(self, lost_s: float, t_s: float) -> None:
        if self._said is None:
            self._counters.add("router_lost")
            self._backoff.reset()
            self._look_why_s, self.why, self._since_s = 0.0, "", t_s - lost_s
        elif t_s < self._look_why_s:
            return
        self._look_why_s = t_s + self._backoff.next_s()
        self.why = obstacle(self._bus.endpoint)
        what = f"the router at {self._bus.endpoint}" + (f": {self.why}" if self.why else "")
        if what != self._said:
            log.warning("lost %s", what)
            self._said = what
            self._waiting.obstruct(what)

    def _found(self) -> None:
        self._said, self.why = None, ""
        self._waiting.obstruct(None)
        log.warning(
            "the router at %s is back after %.0f s", self._bus.endpoint, now_s() - self._since_s
        )

    def close(self) -> None:
        """Looks no more."""
        self._closed.set()
        self._thread.join()
