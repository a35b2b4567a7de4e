import subprocess
import sys

import pytest

from bpn_shared.runtime.entry import run_slot_worker
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig


def serve(_worker: Worker, _config: RunConfig) -> int:
    raise AssertionError("it must not come so far")


def exit_of(*arguments: str) -> int:
    return run_slot_worker("edge", "an edge", serve, [*arguments])


def test_what_is_no_endpoint_is_one_line_and_not_waited_for() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bpn_edge", "--connect", "router"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.endswith(
        "edge ERROR 'router' is no endpoint of a router: give tcp/HOST:PORT, tls/HOST:PORT or unixsock-stream/PATH"
    )


@pytest.mark.parametrize("slot", ["-1", "one", "\u0661"])
def test_a_slot_that_is_none_is_refused(slot: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_status:
        exit_of("--run", "00000000-0000-0000-0000-000000000001", f"--slot={slot}")
    assert exit_status.value.code == 2
    assert "is no number from 0 on" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [["--run", "00000000-0000-0000-0000-000000000001"], ["--slot", "0"]],
)
def test_half_a_place_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_status:
        run_slot_worker("edge", "an edge", serve, arguments)
    assert exit_status.value.code == 2
    assert "--run and --slot belong together" in capsys.readouterr().err
