"""Round trips between two processes over a plain TCP socket: what the machine gives."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable

_ECHO = """
import socket, sys
port, request_bytes, answer_bytes = map(int, sys.argv[1:])
with socket.create_connection(("127.0.0.1", port)) as link:
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    answer, received = bytes(answer_bytes), 0
    while data := link.recv(65536):
        received += len(data)
        if received == request_bytes:
            link.sendall(answer)
            received = 0
"""


def tcp_round_trips_us(
    request_bytes: int,
    answer_bytes: int,
    count: int,
    between: Callable[[], None] = lambda: None,
) -> list[float]:
    """Times `count` round trips on loopback, microseconds each, with a call of `between` before each."""
    times_us: list[float] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(20)
        sizes = [str(server.getsockname()[1]), str(request_bytes), str(answer_bytes)]
        with subprocess.Popen([sys.executable, "-c", _ECHO, *sizes]) as echo:  # noqa: S603 - ours
            link, _ = server.accept()
            with link:
                link.settimeout(20)
                link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                for _ in range(count):
                    between()
                    times_us.append(_round_trip_us(link, request_bytes))
            echo.wait(20)
    return times_us


def _round_trip_us(link: socket.socket, request_bytes: int) -> float:
    request = bytes(request_bytes)
    start_ns = time.perf_counter_ns()
    link.sendall(request)
    link.recv(65536)  # the answer is far smaller than a segment, so it comes whole
    return (time.perf_counter_ns() - start_ns) / 1e3
