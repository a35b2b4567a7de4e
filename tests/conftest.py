import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from ports import free_tcp_port
from process_state import kept

from bpn_shared.bus.session import Bus

DEADLINE_S = float(os.environ.get("BPN_TEST_DEADLINE_S", "60"))
"""Only what is broken waits so long; `make mutants`, which breaks things, waits less."""

# A busy machine is no failure; examples that hang end with pytest's own time limit.
settings.register_profile("bpn", deadline=None)
settings.load_profile("bpn")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol() -> Generator[None, object, object]:
    """What a test does to its process, as commands do to theirs, the next test does not see."""
    with kept():
        return (yield)


def wait_for(condition: Callable[[], object], what: str, timeout_s: float = DEADLINE_S) -> None:
    """Waits for a condition, and fails the test saying what did not happen."""
    deadline_s = time.monotonic() + timeout_s
    pause = threading.Event()
    while not condition():
        if time.monotonic() > deadline_s:
            pytest.fail(f"waited {timeout_s:.0f} s for {what}")
        pause.wait(0.01)


@pytest.fixture(name="wait_for", scope="session")
def _wait_for() -> Callable[..., None]:
    return wait_for


@pytest.fixture(name="free_tcp_port", scope="session")
def _free_tcp_port() -> Callable[[], int]:
    """Finds a loopback port that nobody listens at."""
    return free_tcp_port


def free_tcp_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_tcp_port()}"


@pytest.fixture(name="free_tcp_endpoint")
def _free_tcp_endpoint() -> str:
    """A loopback port that nobody listens at."""
    return free_tcp_endpoint()


@contextlib.contextmanager
def running_router(endpoint: str) -> Iterator[None]:
    """A router in a process of its own, as in real life; ready when this yields."""
    process = subprocess.Popen(
        [sys.executable, "-m", "bpn_shared.bus.router", "--listen", endpoint]
    )
    try:
        Bus(endpoint, deadline_s=DEADLINE_S).close()  # it waits until the router is there
        yield
    finally:
        process.terminate()
        process.wait(10)


@pytest.fixture(name="running_router")
def _running_router() -> Callable[[str], contextlib.AbstractContextManager[None]]:
    return running_router


@pytest.fixture
def endpoint() -> Iterator[str]:
    """The address of a router that only this test uses."""
    address = free_tcp_endpoint()
    with running_router(address):
        yield address


@pytest.fixture
def open_bus(endpoint: str) -> Iterator[Callable[[], Bus]]:
    """Opens sessions that are closed with the test."""
    opened: list[Bus] = []

    def open_one() -> Bus:
        opened.append(Bus(endpoint, deadline_s=DEADLINE_S))
        return opened[-1]

    yield open_one
    for bus in opened:
        bus.close()


def command_line(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "bpn", *arguments]


@pytest.fixture(scope="session")
def command() -> Callable[..., list[str]]:
    """The `bpn` command with these arguments."""
    return command_line


@pytest.fixture(scope="session")
def train(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., dict[str, Any]]:
    """`bpn train --json` as a user would call it; returns the final object."""

    def run(*arguments: str, runs_dir: Path | None = None) -> dict[str, Any]:
        runs_dir = runs_dir or tmp_path_factory.mktemp("runs")
        done = subprocess.run(
            command_line("train", *arguments, "--json", "--runs-dir", str(runs_dir)),
            capture_output=True,
            text=True,
            timeout=280,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        result: dict[str, Any] = json.loads(done.stdout)
        return result | {"runs_dir": str(runs_dir), "stderr": done.stderr}

    return run
