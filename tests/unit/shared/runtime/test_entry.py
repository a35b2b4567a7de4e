import subprocess
import sys

import pytest

from bpn_shared.runtime.entry import slot_options, slot_parser


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
        slot_options(
            slot_parser("edge", "an edge"),
            ["--run", "00000000-0000-0000-0000-000000000001", f"--slot={slot}"],
        )
    assert exit_status.value.code == 2
    assert "is no number from 0 on" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [["--run", "00000000-0000-0000-0000-000000000001"], ["--slot", "0"]],
)
def test_half_a_place_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_status:
        slot_options(slot_parser("edge", "an edge"), arguments)
    assert exit_status.value.code == 2
    assert "--run and --slot belong together" in capsys.readouterr().err
