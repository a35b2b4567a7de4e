"""Whatever happens, within a minute a run goes on, or REST and the terminal say why it does not.

What the page shows is what REST tells (`tests/browser/test_waiting.py`). Frozen and cut-off learners, environments
that break, renewed certificates and a full disk in containers have tests of their own; the seconds that all of
them took are in ARCHITECTURE.md (Never stuck). `pytest -s` prints those of this file.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from flags import flags
from pool import LONG_S, Pool, frozen, running_pool

from bpn.dashboard import Dashboard, DashboardError
from bpn_shared.bus import keys
from bpn_shared.bus.requests import NoReplyError, RefusedError, request
from bpn_shared.bus.session import Bus

WITHIN_S = 60.0
SMALL = [
    "--seed",
    "5",
    "--iterations",
    "2",
    "--episodes",
    "4",
    "--epochs",
    "1",
    "--hidden-units",
    "24",
]
CONFIG = {
    "task": "reaching",
    "seed": 5,
    "iterations": 3,
    "episodes": 20,
    "epochs": 1,
    "hidden_units": 24,
}
WaitFor = Callable[..., None]


class Terminal:
    """`bpn train` in a terminal, and what it said there so far."""

    def __init__(self, directory: Path, *arguments: str) -> None:
        self._said = directory / "said"
        with self._said.open("w") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "bpn", "train", *arguments],
                stdout=said, stderr=subprocess.STDOUT, text=True,
            )  # fmt: skip

    @property
    def said(self) -> str:
        """Lines that were wrapped are put together."""
        return " ".join(self._said.read_text().split())

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(30)


@contextlib.contextmanager
def terminal(directory: Path, *arguments: str) -> Iterator[Terminal]:
    with contextlib.closing(Terminal(directory, *arguments)) as opened:
        yield opened


def newest_run(pool: Pool) -> dict[str, Any]:
    """Empty until there is one."""
    runs: list[dict[str, Any]] = pool.dashboard._call("GET", "/runs?sort=-created_at")["items"]
    return runs[0] if runs else {}


def told_of(pool: Pool, key: str) -> str:
    return str(newest_run(pool).get(key, ""))


def readable_s(wait_for: WaitFor, sentence: str, **doors: Callable[[], str]) -> None:
    """Waits until the sentence is readable at every door, and prints how long that took."""
    begin_s = time.monotonic()
    for door, text in doors.items():
        wait_for(lambda text=text: sentence in text(), f"{sentence!r} at {door}", WITHIN_S)
        print(f"READABLE {sentence!r} at {door}: {time.monotonic() - begin_s:.1f} s")


def test_where_no_edge_has_onnx_runtime_a_float_run_fails_with_that_reason(
    tmp_path: Path, wait_for: WaitFor
) -> None:
    missing = tmp_path / "packages" / "onnxruntime"
    missing.mkdir(parents=True)
    (missing / "__init__.py").write_text(
        "raise ModuleNotFoundError(\"No module named 'onnxruntime'\", name='onnxruntime')"
    )
    environment = os.environ | {"PYTHONPATH": str(missing.parent)}
    with running_pool(tmp_path / "runs", environment=environment) as pool:
        options = ("reaching", "--algorithm", "cvi", *SMALL, "--runs-dir", str(pool.runs_dir))
        with terminal(tmp_path, *options) as shown:
            sentence = "needs onnxruntime, which is not installed"
            readable_s(
                wait_for,
                sentence,
                rest=lambda: told_of(pool, "error"),
                terminal=lambda: shown.said,
            )
            assert shown.process.wait(30) == 1
        assert newest_run(pool)["state"] == "failed"


def test_an_edge_of_an_older_protocol_is_named_at_the_run_that_lacks_it(
    tmp_path: Path, wait_for: WaitFor
) -> None:
    """What an edge of protocol 1 asks, as one (of commit c1cfefb) said it on the bus and it was recorded there."""
    asked = (
        Path(__file__).parents[1] / "golden" / "protocol-1" / "lease-request.msgpack"
    ).read_bytes()
    with (
        running_pool(tmp_path / "runs", "--edges", "0") as pool,
        terminal(tmp_path, "reaching", *SMALL, "--runs-dir", str(pool.runs_dir)) as shown,
        Bus(pool.dashboard.endpoint) as bus,
    ):

        def told(text: str) -> str:
            with contextlib.suppress(RefusedError, NoReplyError):
                request(bus, keys.lease_request(), asked, timeout_s=5.0)
            return text

        readable_s(
            wait_for,
            "edge-b2d36365fab3 speaks protocol 1",
            rest=lambda: told(told_of(pool, "waiting_reason")),
            terminal=lambda: told(shown.said),
        )


def test_without_a_router_runs_say_so_and_go_on_when_it_is_back(
    tmp_path: Path, wait_for: WaitFor, train: Callable[..., dict[str, Any]]
) -> None:
    given = flags(CONFIG)
    undisturbed = train("reaching", *given)["weights_sha256"]
    with (
        running_pool(tmp_path / "runs") as pool,
        terminal(tmp_path, "reaching", *given, "--runs-dir", str(pool.runs_dir)) as shown,
    ):
        wait_for(lambda: told_of(pool, "state") == "running", "the run to begin", LONG_S)
        run_id = newest_run(pool)["id"]
        wait_for(pool.folder(run_id).episode_path(0, 3).exists, "episodes", LONG_S)
        (router,) = pool.services("bpn_shared.bus.router")
        with frozen(router):
            readable_s(
                wait_for, "the router", rest=lambda: pool.run(run_id)["waiting_reason"],
                terminal=lambda: shown.said,
            )  # fmt: skip
        begin_s = time.monotonic()
        wait_for(lambda: pool.state(run_id) == "finished", "the end", LONG_S)
        print(f"ENDED {time.monotonic() - begin_s:.1f} s after the router was back")
        assert pool.sha256(run_id) == undisturbed


def test_of_two_dashboards_on_one_router_the_second_says_that_it_only_shows(
    tmp_path: Path, wait_for: WaitFor
) -> None:
    second_runs = tmp_path / "second"
    with running_pool(tmp_path / "runs") as pool:
        process = subprocess.Popen(
            [sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(second_runs), "--port", "0",
             "--connect", pool.dashboard.endpoint],
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            found: list[Dashboard | None] = []
            wait_for(lambda: found.append(Dashboard.find(second_runs)) or found[-1], "it", LONG_S)
            second = found[-1]
            assert second is not None

            def refusal() -> str:
                try:
                    second.create_run({"task": "reaching"})
                except DashboardError as error:
                    return str(error)
                return ""

            readable_s(wait_for, "read-only", rest=refusal)
            with terminal(tmp_path, "reaching", *SMALL, "--runs-dir", str(second_runs)) as shown:
                readable_s(wait_for, "read-only", terminal=lambda: shown.said)
                assert shown.process.wait(30) != 0
            run_id = pool.dashboard.create_run(CONFIG)["id"]
            wait_for(lambda: pool.state(run_id) == "finished", "the first one's run", LONG_S)
            assert pool.run(run_id)["attempt"] == 1
        finally:
            process.terminate()
            process.wait(30)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(disk)], check=True)
    try:
        yield disk
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


@pytest.mark.skipif(os.geteuid() != 0, reason="mounts a small disk; containers have theirs")
def test_on_a_full_disk_a_run_says_so_and_goes_on_when_there_is_room(
    tmp_path: Path, small_disk: Path, wait_for: WaitFor
) -> None:
    with (
        running_pool(small_disk) as pool,
        terminal(
            tmp_path, "reaching", "--iterations", "6", "--episodes", "20", "--epochs", "1", "--hidden-units", "24",
            "--runs-dir", str(pool.runs_dir),
        ) as shown,
    ):  # fmt: skip
        wait_for(lambda: told_of(pool, "state") == "running", "the run to begin", LONG_S)
        run_id = newest_run(pool)["id"]
        wait_for(pool.folder(run_id).episode_path(0, 3).exists, "episodes", LONG_S)
        ballast = small_disk / "ballast"
        with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
        assert shutil.disk_usage(small_disk).free < 4096
        readable_s(
            wait_for, "No space left on device", rest=lambda: pool.run(run_id)["waiting_reason"],
            terminal=lambda: shown.said,
        )  # fmt: skip
        ballast.unlink()
        begin_s = time.monotonic()
        wait_for(lambda: pool.run(run_id)["iteration"] == 6, "the end", LONG_S)
        print(f"ENDED {time.monotonic() - begin_s:.1f} s after there was room")
