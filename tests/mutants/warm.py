"""Runs pytest again and again, in forks of a process that has the large libraries loaded, which takes longest.

    python -m tests.mutants.warm LIBRARY ...

Each line that it reads is a JSON list: arguments of pytest, path of its output, seconds that it may take, and
seconds of the processor that it may take. Each that it writes is the exit status (below 0: a signal; null: it did
not end in time), and the seconds of the processor that it took.
"""

import contextlib
import gc
import importlib
import json
import math
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence

import pytest

_POLL_S = 0.02


def main() -> None:
    for name in sys.argv[1:]:
        importlib.import_module(name)
    gc.freeze()  # or every fork would copy what it only looks through
    for line in sys.stdin:
        print(json.dumps(_forked(*json.loads(line))), flush=True)


def _forked(
    arguments: Sequence[str], output: str, timeout_s: float, cpu_s: float
) -> tuple[int | None, float]:
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(cpu_s), math.ceil(cpu_s) + 1))
        _run(arguments, output)
    try:
        return _waited(pid, time.monotonic() + timeout_s)
    finally:
        with contextlib.suppress(ProcessLookupError):  # what it has left behind, too
            os.killpg(pid, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(pid, 0)


def _waited(pid: int, deadline_s: float) -> tuple[int | None, float]:
    while time.monotonic() < deadline_s:
        done, status, used = os.wait4(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime
        time.sleep(_POLL_S)
    return None, 0.0


def _run(arguments: Sequence[str], output: str) -> None:
    status = -1
    try:
        os.setsid()
        file = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, 1)
        os.dup2(file, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        status = int(pytest.main(list(arguments)))
        sys.stdout.flush()
    finally:
        os._exit(status & 0xFF)


if __name__ == "__main__":
    main()
