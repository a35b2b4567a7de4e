"""`bpn up` for other machines: what is documented works, and what would not is told at once."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn.cli import main
from bpn_certificates.folders import make
from bpn_shared.bus.certificates import FOLDER_VARIABLE, KEY

WaitFor = Callable[..., None]


def test_a_worker_of_another_machine_takes_part(
    tmp_path: Path,
    command: Callable[..., list[str]],
    free_tcp_port: Callable[[], int],
    wait_for: WaitFor,
) -> None:
    certificates, runs, port = tmp_path / "certificates", tmp_path / "runs", free_tcp_port()
    make(certificates, days=1, server_names=["localhost"])
    up = subprocess.Popen(
        command(
            "up", "--runs-dir", str(runs), "--port", "0", "--edges", "0", "--first-run", "reaching",
            "--listen", f"tls/0.0.0.0:{port}", "--certificates", str(certificates),
            "--enrolment-port", "0",
        ),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    edge = subprocess.Popen(
        [sys.executable, "-m", "bpn_edge", "--connect", f"tls/localhost:{port}"],
        env={**os.environ, FOLDER_VARIABLE: str(certificates / "edge")},
        stderr=subprocess.DEVNULL,
    )
    try:

        def learned() -> bool:
            assert up.poll() is None, up.stderr and up.stderr.read()
            return any((path / "metrics.jsonl").exists() for path in runs.glob("*-*"))

        wait_for(learned, "an iteration with the edge from elsewhere", 120)
    finally:
        edge.terminate()
        up.send_signal(signal.SIGINT)
        up.communicate(timeout=30)
        edge.wait(30)
    assert up.returncode == 130


@pytest.mark.parametrize(
    ("listen", "certified", "said"),
    [
        ("tls/0.0.0.0:0", False, "a port that stays"),
        ("tcp/0.0.0.0:0", False, "can be reached from other machines"),
        ("tls/192.0.2.1:0", True, "--server-name 192.0.2.1"),
        (None, True, "add --listen"),
    ],
)
def test_what_the_router_would_refuse_is_told_at_once(
    listen: str | None, certified: bool, said: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    options = ["up", "--port", "0", "--runs-dir", str(tmp_path / "runs")]
    if listen is not None:
        options += ["--listen", listen]
    if certified:
        make(tmp_path / "certificates", days=1, server_names=["localhost"])
        options += ["--certificates", str(tmp_path / "certificates")]
    begin_s = time.monotonic()
    assert main(options) == 2
    assert time.monotonic() - begin_s < 10
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_a_role_without_its_key_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path / "certificates", days=1, server_names=["localhost"])
    (tmp_path / "certificates" / "edge" / KEY).unlink()
    options = ["--listen", "tls/localhost:0", "--certificates", str(tmp_path / "certificates")]
    assert main(["up", "--port", "0", "--runs-dir", str(tmp_path / "runs"), *options]) == 2
    assert str(tmp_path / "certificates" / "edge" / KEY) in capsys.readouterr().err


def test_an_endpoint_that_cannot_be_had_ends_it_with_its_reason(
    tmp_path: Path, command: Callable[..., list[str]]
) -> None:
    nowhere = f"unixsock-stream/{tmp_path}/nowhere/router.sock"
    done = subprocess.run(
        command("up", "--runs-dir", str(tmp_path / "runs"), "--port", "0", "--listen", nowhere),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "No such file or directory" in line
    assert ".rs:" not in line
