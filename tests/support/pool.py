"""`bpn up` as its users have it, for tests that start runs in its dashboard and do things to its services."""

import contextlib
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

import psutil

from bpn.dashboard import Dashboard
from bpn_shared.bus import keys
from bpn_shared.bus.liveliness import TokenWatch
from bpn_shared.bus.requests import request
from bpn_shared.bus.session import Bus
from bpn_shared.runs.folder import RunFolder

LONG_S = 200.0


@dataclass
class Pool:
    """A running `bpn up` and its dashboard."""

    process: subprocess.Popen[str]
    runs_dir: Path
    dashboard: Dashboard

    def services(self, module: str) -> list[psutil.Process]:
        """The processes of a service, by the module that they run."""
        found = []
        for child in psutil.Process(self.process.pid).children():
            with contextlib.suppress(psutil.NoSuchProcess):  # just killed
                if module in child.cmdline():
                    found.append(child)
        return found

    def folder(self, run_id: str) -> RunFolder:
        return RunFolder(self.runs_dir / run_id)

    def run(self, run_id: str) -> dict[str, Any]:
        """What REST tells of a run."""
        return self.dashboard.run(run_id)

    def state(self, run_id: str) -> str:
        state: str = self.run(run_id)["state"]
        return state

    def sha256(self, run_id: str) -> str:
        return self.folder(run_id).newest_weights().content_sha256()

    def learner(self, run_id: str, rank: int = 0) -> psutil.Process:
        """The process that is the run's learner now, as it says itself."""
        with Bus(self.dashboard.endpoint) as bus:
            tokens: list[str] = []
            pattern = keys.lease(UUID(run_id), "learner", rank, "*")
            watch = TokenWatch(bus, pattern, lambda key, _: tokens.append(key))
            _wait_for(lambda: bool(tokens), "the learner's token")
            worker = tokens[-1].rsplit("/", 1)[-1]
            report = json.loads(request(bus, keys.health("learner", worker), b"", timeout_s=20.0))
            watch.close()
        assert report["run"] == run_id
        return psutil.Process(int(report["pid"]))


@contextlib.contextmanager
def running_pool(
    runs_dir: Path,
    *options: str,
    environment: Mapping[str, str] | None = None,
    program: Sequence[str] = (sys.executable, "-m", "bpn"),
    folder: Path | None = None,
) -> Iterator[Pool]:
    """`bpn up` with some options, in a folder if one is given; stopped with Ctrl-C at the end."""
    process = subprocess.Popen(
        [*program, "up", "--port", "0", "--runs-dir", str(runs_dir), *options],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
        env=None if environment is None else dict(environment),
    )
    try:
        found: list[Dashboard | None] = []
        _wait_for(
            lambda: bool(found.append(Dashboard.find(runs_dir)) or found[-1]), "the dashboard"
        )
        assert found[-1] is not None
        yield Pool(process, runs_dir, found[-1])
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "bpn dashboard: http://127.0.0.1:" in output
    assert "#token=" in output


@contextlib.contextmanager
def frozen(process: psutil.Process) -> Iterator[None]:
    """The process stands still while the body runs."""
    process.suspend()
    try:
        yield
    finally:
        process.resume()


def _wait_for(condition: Any, what: str) -> None:
    deadline_s, pause = time.monotonic() + LONG_S, threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s, f"waited {LONG_S:.0f} s for {what}"
        pause.wait(0.05)
