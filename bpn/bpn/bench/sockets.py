"""Round trips between two processes over a Unix socket: what the machine gives."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable

_ECHO = """
import socket, sys
number, request_bytes, answer_bytes = map(int, sys.argv[1:])
with socket.socket(fileno=number) as link:
    answer = bytes(answer_bytes)
    while link.recv(request_bytes):
        link.send(answer)
"""
_TIMEOUT_S = 20


def socket_round_trips_us(
    request_bytes: int,
    answer_bytes: int,
    count: int,
    between: Callable[[], None] = lambda: None,
) -> list[float]:
    """Times `count` round trips, microseconds each, with a call of `between` before each.

    The other process has the cores that this one has.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    numbers = [str(number) for number in (theirs.fileno(), request_bytes, answer_bytes)]
    with subprocess.Popen(  # noqa: S603 - ours
        [sys.executable, "-c", _ECHO, *numbers], pass_fds=[theirs.fileno()]
    ) as echo:
        theirs.close()
        with ours:
            ours.settimeout(_TIMEOUT_S)
            _round_trip_us(ours, request_bytes)  # once it has started
            times_us: list[float] = []
            for _ in range(count):
                between()
                times_us.append(_round_trip_us(ours, request_bytes))
        echo.wait(_TIMEOUT_S)
    return times_us


def _round_trip_us(link: socket.socket, request_bytes: int) -> float:
    request = bytes(request_bytes)
    start_ns = time.perf_counter_ns()
    link.send(request)
    link.recv(request_bytes)
    return (time.perf_counter_ns() - start_ns) / 1e3
