"""Loopback ports for whatever a test starts in another process, which has to be told one."""

import random
import socket

_FIRST, _LAST = 20_000, 32_000
"""Below those that systems give to outgoing connections, which could take a port before it is listened at."""
_last_found = random.SystemRandom().randrange(_FIRST, _LAST)  # elsewhere in a process beside this


def free_tcp_port() -> int:
    """A port that nobody listens at, and another one each time."""
    global _last_found  # noqa: PLW0603 - of the process, as ports are
    while True:
        _last_found = _last_found + 1 if _last_found < _LAST else _FIRST
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", _last_found))
            except OSError:
                continue
            return _last_found
