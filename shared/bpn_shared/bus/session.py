"""A service's session with the router."""

import json
import logging
import sys
import threading
import time
from collections.abc import Callable

import zenoh

from bpn_shared.backoff import Backoff
from bpn_shared.bus.certificates import client_tls
from bpn_shared.bus.endpoint import check_endpoint
from bpn_shared.bus.obstacle import obstacle, plain
from bpn_shared.bus.traffic import Traffic
from bpn_shared.closing import Closing

log = logging.getLogger(__name__)

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
OPEN_DEADLINE_S = 60.0


def prepare_process() -> None:
    """Sets what sessions need and a whole process has; its `main` calls it once."""
    # A thread that computes holds the GIL for 5 ms by default, and every message waits that long.
    sys.setswitchinterval(0.0005)
    zenoh.init_log_from_env_or("off")  # peers come and go here; what matters is logged by us


class BusError(RuntimeError):
    """The router cannot be reached; the message says where and for how long it was tried."""


def _client_config(endpoint: str) -> zenoh.Config:
    check_endpoint(endpoint)
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "client",
                "connect": {
                    "endpoints": [endpoint],
                    "timeout_ms": 0,
                    # after a lost link: soon again, so that a restarted router costs little
                    "retry": {
                        "period_init_ms": 50,
                        "period_max_ms": 500,
                        "period_increase_factor": 1.5,
                    },
                },
                "scouting": {"multicast": {"enabled": False}},
                "transport": {
                    "shared_memory": {"enabled": False},
                    "link": {"tx": {"lease": 3000}, "tls": client_tls(endpoint)},
                },
            }
        )
    )


class Bus(Closing):
    """One session as a client of the router. Use as a context manager: an unclosed one keeps the process.

    Args:
        endpoint: the router's Zenoh endpoint, such as "tcp/127.0.0.1:7447" or "tls/router:7447"; the latter
            needs certificates (`bpn_shared.bus.certificates`).
        deadline_s: how long to wait for the router.
        stop: when set, waiting ends.
        traffic: where to count what is sent and received, if another session counts there too.

    Raises:
        BusError: no router at the endpoint within the deadline, or `stop` was set.
        InputError: it is no endpoint, or it needs certificates, and there are none.
    """

    def __init__(
        self,
        endpoint: str = DEFAULT_ENDPOINT,
        *,
        deadline_s: float = OPEN_DEADLINE_S,
        stop: threading.Event | None = None,
        traffic: Traffic | None = None,
    ) -> None:
        self.endpoint = endpoint
        self._ends: list[Callable[[], None]] = []
        self.traffic = traffic or Traffic()
        self.zenoh = _open(endpoint, deadline_s, stop or threading.Event())

    def before_close(self, end: Callable[[], None]) -> None:
        """Has `end` called before the session ends: for threads that use it."""
        self._ends.append(end)

    def close(self) -> None:
        """Ends the session; its declarations and tokens go with it."""
        for end in self._ends:
            end()
        try:
            self.zenoh.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:  # seen under packet loss; the session is gone all the same
            log.warning("closing the session: %s", error)

    @property
    def connected(self) -> bool:
        """Whether the router is reached now."""
        return bool(self.router)

    @property
    def router(self) -> str:
        """Names the router that is reached now, another one after its restart; empty: none is."""
        return " ".join(str(router) for router in self.zenoh.info.routers_zid())


def _open(endpoint: str, deadline_s: float, stop: threading.Event) -> zenoh.Session:
    config = _client_config(endpoint)
    start_s = time.monotonic()
    tries, looks = Backoff(0.1, 0.5), Backoff(2.0, 30.0)
    look_s, reason = start_s, ""
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            waited_s = time.monotonic() - start_s
            if waited_s > deadline_s or time.monotonic() >= look_s:
                why = obstacle(endpoint) or plain(error)
                look_s = time.monotonic() + looks.next_s()
                if why != reason and waited_s <= deadline_s:
                    log.info("waiting for the Zenoh router at %s: %s", endpoint, why)
                reason = why
            if waited_s > deadline_s:
                raise BusError(
                    f"the Zenoh router at {endpoint} is not reached after {deadline_s:.0f} s: {reason}"
                ) from error
        if stop.wait(tries.next_s()):
            raise BusError(f"stopped while waiting for the Zenoh router at {endpoint}")
