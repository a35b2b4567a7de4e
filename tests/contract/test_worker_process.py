"""A worker as a process of its own: how it ends, and what it says last."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

WaitFor = Callable[..., None]
RunningRouter = Callable[[str], contextlib.AbstractContextManager[None]]
RUN = "00000000-0000-0000-0000-000000000001"

PROGRAM = """
import sys
from pathlib import Path
from bpn_shared.runtime.entry import argument_parser, run_worker
from bpn_shared.runtime.worker import EXIT_FINISHED

def serve(worker):
    how = sys.argv[2]
    if how == "raise":
        return int("a line\\nand another")
    if how == "full":
        Path("/dev/full").write_text("more")
    print("working", flush=True)
    worker.stop.wait(60)
    return EXIT_FINISHED

options = argument_parser("learner", "").parse_args(["--run", sys.argv[3], "--connect", sys.argv[1]])
raise SystemExit(run_worker("learner", options, serve, holds_on_s=2.0))
"""


def worker(endpoint: str, how: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, endpoint, how, RUN],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def errors(stderr: str) -> list[str]:
    return [line for line in stderr.splitlines() if " ERROR " in line]


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("raise", r"ValueError: invalid literal for int() with base 10: 'a line\nand another'"),
        ("full", "No space left on device"),
    ],
)
def test_an_exception_that_nobody_foresaw_is_one_line_of_error_and_a_traceback(
    endpoint: str, how: str, said: str
) -> None:
    _, stderr = (process := worker(endpoint, how)).communicate(timeout=60)
    assert process.returncode == 1
    (error,) = errors(stderr)
    assert error.endswith(f"learner ERROR {said}")
    assert "Traceback" in stderr


def test_without_a_router_for_too_long_it_ends_and_says_why(
    running_router: RunningRouter, free_tcp_endpoint: str
) -> None:
    with running_router(free_tcp_endpoint):
        process = worker(free_tcp_endpoint, "wait")
        assert process.stdout is not None
        assert process.stdout.readline() == "working\n"
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 1
    (error,) = errors(stderr)
    assert f"the router at {free_tcp_endpoint} is lost for " in error


def test_it_is_alive_and_not_ready_while_the_router_is_away(
    running_router: RunningRouter,
    free_tcp_endpoint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    wait_for: WaitFor,
) -> None:
    alive, ready = tmp_path / "heartbeat", tmp_path / "heartbeat.ready"
    monkeypatch.setenv("BPN_HEARTBEAT", str(alive))
    process = worker(free_tcp_endpoint, "wait")
    try:
        wait_for(alive.exists, "a heartbeat before there is a router")
        assert not ready.exists()
        with running_router(free_tcp_endpoint):
            wait_for(ready.exists, "it to be ready")
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate(timeout=10)


def test_on_a_full_disk_it_goes_on_without_log_and_heartbeat(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BPN_HEARTBEAT", "/dev/full")
    with Path("/dev/full").open("w") as full:
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, endpoint, "wait", RUN],
            stdout=subprocess.PIPE,
            stderr=full,
            text=True,
        )
    assert process.stdout is not None
    assert process.stdout.readline() == "working\n"
    process.terminate()
    assert process.wait(30) == 0
