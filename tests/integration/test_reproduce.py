"""`bpn reproduce --quick`: from nothing to the files, interrupted on the way."""

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from bpn_shared.runs.folder import RunFolder

Command = Callable[..., list[str]]


@pytest.fixture(scope="module")
def runs_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for all targets, which share runs."""
    return tmp_path_factory.mktemp("reproduce")


def reproduce(
    command: Command, runs_dir: Path, *arguments: str, status: int = 0
) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        command("reproduce", *arguments, "--quick", "--seeds", "1", "--runs-dir", str(runs_dir)),
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    return done


def document(runs_dir: Path, target: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((runs_dir / "quick" / f"{target}.json").read_text())
    return found


def folders(runs_dir: Path) -> list[RunFolder]:
    return [RunFolder(path.parent) for path in sorted(runs_dir.glob("*/config.json"))]


def test_an_interrupted_campaign_goes_on_and_makes_no_finished_run_again(
    runs_dir: Path, command: Command, wait_for: Callable[..., None]
) -> None:
    arguments = ["reproduce", "tracking", "--quick", "--seeds", "1", "--algorithms", "bpn,cvi"]
    process = subprocess.Popen(
        command(*arguments, "--runs-dir", str(runs_dir)), stdout=subprocess.PIPE, text=True
    )

    def states() -> list[str]:
        return [folder.state().state for folder in folders(runs_dir)]

    try:
        wait_for(
            lambda: sorted(states()) == ["finished", "running"], "one run finished, one going", 120
        )
        process.send_signal(signal.SIGINT)
        services = psutil.Process(process.pid).children(recursive=True)
        output, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "1 of 2 runs are finished; go on with: bpn reproduce tracking" in output
    assert not [service for service in services if service.is_running()]
    assert not (runs_dir / "quick").exists()
    assert sorted(states()) == ["finished", "stopped"]

    again = reproduce(command, runs_dir, "tracking", "--algorithms", "bpn,cvi", "--jobs", "2")
    assert "1 of 2 runs are there already" in again.stdout
    assert states() == ["finished", "finished"]
    attempts = {folder.config().algorithm: folder.state().attempt for folder in folders(runs_dir)}
    assert attempts["bpn"] == 1
    made = document(runs_dir, "tracking")
    assert [run["algorithm"] for run in made["runs"]] == ["bpn", "cvi"]
    for run, folder in zip(made["runs"], folders(runs_dir), strict=True):
        lines = folder.metrics()
        assert run["returns_px"] == pytest.approx([line["return_px"] for line in lines], abs=0.01)
        assert run["weights_sha256"] == folder.newest_weights().content_sha256()
    names = [line["name"] for line in made["result"]["references"]]
    assert names == ["optimum", "greedy on the truth", "random play"]


def test_latency_uses_the_runs_that_are_there(runs_dir: Path, command: Command) -> None:
    done = reproduce(command, runs_dir, "latency")
    before = len(folders(runs_dir))
    result = document(runs_dir, "latency")["result"]
    server = result["computers"]["server over Zenoh"]
    assert all(server[part]["p50"] > 0 for part in ("send_us", "compute_us", "receive_us"))
    assert {trials["delay_ms"] for trials in result["trials"]} == {0, 1003}
    late = next(trials for trials in result["trials"] if trials["delay_ms"] == 1003)
    # the first action acts in the seventh period
    assert late["deadline_misses"] >= sum(min(6, steps) for steps in late["lengths"])
    assert "plays with" in done.stdout

    kept = sorted((runs_dir / "trials").rglob("*.bpne"))
    assert len(kept) == 4
    times = [path.stat().st_mtime_ns for path in kept]
    reproduce(command, runs_dir, "latency")  # recalls them
    assert [path.stat().st_mtime_ns for path in kept] == times
    assert len(folders(runs_dir)) == before


def test_inference_puts_the_papers_times_beside_ours(runs_dir: Path, command: Command) -> None:
    reproduce(command, runs_dir, "inference")
    table = (runs_dir / "quick" / "inference.md").read_text()
    assert "| RTL, 100 MHz (simulated) | 0.1" in table
    assert "| DQN, FPGA (paper) | 1,003 |" in table
    assert "| native portable |" in table
    assert "| golden |" in table
    assert (runs_dir / "quick" / "inference.png").exists()


def test_an_algorithm_that_the_target_does_not_compare_is_refused(
    runs_dir: Path, command: Command
) -> None:
    done = reproduce(command, runs_dir, "pan-tilt", "--algorithms", "bpn,ppo", status=2)
    assert "pan-tilt compares bpn, bqn, not ppo" in done.stderr
