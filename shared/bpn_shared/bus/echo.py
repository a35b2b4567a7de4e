"""`python -m bpn_shared.bus.echo`: what a round trip over the bus costs, with nothing else in it.

The yardsticks for the loop's camera-to-action latency: same bytes there and back, through the same router or
over a link of two sessions. Once as two streams whose receivers answer on the network thread, once as Zenoh's
request and reply.
"""

import argparse
import json
import threading
import time
from collections.abc import Callable

import zenoh

from bpn_shared.bus.requests import Responder, request
from bpn_shared.bus.router_config import bare
from bpn_shared.bus.session import DEFAULT_ENDPOINT, Bus, prepare_process
from bpn_shared.counters import Counters
from bpn_shared.runtime.service import end_with_supervisor, set_up_logging, stop_on_signals

PING, PONG, REQUEST = "bpn/echo/ping", "bpn/echo/pong", "bpn/echo/request"


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME,
    )


class Echo:
    """Answers every ping that comes to a session with `answer_bytes`."""

    def __init__(self, session: zenoh.Session, answer_bytes: int) -> None:
        answer = bytes(answer_bytes)
        pong = _publisher(session, PONG)

        def receive(sample: zenoh.Sample) -> None:
            sample.payload.to_bytes()
            pong.put(answer)

        self._subscriber = session.declare_subscriber(
            PING, zenoh.handlers.Callback(receive, indirect=False)
        )


def _listening(endpoint: str) -> zenoh.Session:
    """A session that others connect with there, without a router."""
    config = bare() | {"mode": "peer", "listen": {"endpoints": [endpoint]}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def request_times_us(
    bus: Bus, request_bytes: int, count: int, between: Callable[[], None] = lambda: None
) -> list[float]:
    """Times `count` requests of `request_bytes`, microseconds each, with a call of `between` before each.

    Raises:
        NoReplyError: no echo answers.
    """
    payload = bytes(request_bytes)
    times_us = []
    for _ in range(count):
        between()
        start_ns = time.perf_counter_ns()
        request(bus, REQUEST, payload, timeout_s=5.0)
        times_us.append((time.perf_counter_ns() - start_ns) / 1e3)
    return times_us


def round_trips_us(
    bus: Bus,
    request_bytes: int,
    count: int,
    between: Callable[[], None] = lambda: None,
    timeout_s: float = 1.0,
) -> list[float]:
    """Times `count` pings of `request_bytes`, microseconds each, with a call of `between` before each.

    Raises:
        TimeoutError: a pong did not come within the timeout.
    """
    arrived = threading.Event()
    arrival_ns = 0

    def receive(sample: zenoh.Sample) -> None:
        nonlocal arrival_ns
        arrival_ns = time.perf_counter_ns()
        sample.payload.to_bytes()
        arrived.set()

    subscriber = bus.zenoh.declare_subscriber(
        PONG, zenoh.handlers.Callback(receive, indirect=False)
    )
    ping = _publisher(bus.zenoh, PING)
    payload = bytes(request_bytes)
    times_us = []
    for _ in range(count):
        between()
        arrived.clear()
        start_ns = time.perf_counter_ns()
        ping.put(payload)
        if not arrived.wait(timeout_s):
            raise TimeoutError(f"no pong within {timeout_s} s: is an echo running at the router?")
        times_us.append((arrival_ns - start_ns) / 1e3)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return times_us


def main(argv: list[str] | None = None) -> int:
    """Answers pings until stopped."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", default=DEFAULT_ENDPOINT, help="the router's endpoint")
    parser.add_argument("--listen", metavar="ENDPOINT", help="be reached there, without a router")
    parser.add_argument("--answer-bytes", type=int, default=32)
    options = parser.parse_args(argv)
    set_up_logging("echo")
    prepare_process()
    stop = stop_on_signals()
    end_with_supervisor()
    if options.listen is not None:
        with _listening(options.listen) as session:
            echo = Echo(session, options.answer_bytes)
            stop.wait()
            del echo
        return 0
    answer = bytes(options.answer_bytes)
    with (
        Bus(options.connect, stop=stop) as bus,
        Responder(bus, REQUEST, lambda _body: answer, Counters()),
    ):
        echo = Echo(bus.zenoh, options.answer_bytes)
        stop.wait()
        del echo
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
