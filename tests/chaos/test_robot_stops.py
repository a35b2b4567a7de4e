"""kill -9 of edge, robot and router of a robot in motion: it holds, then stops; episodes tell what it was told."""

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from example_packages import where_installed
from installed import install
from journal_robot import JOURNAL, PERIOD_S, Entry, read, spec
from moments import random_moments

from bpn_shared.messages.episode import Episode

WaitFor = Callable[..., None]
SUPPORT = Path(__file__).parents[1] / "support"
HOLD = spec().hold_action
EPISODES = 8


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    return tmp_path / "journal"


@pytest.fixture
def environment(tmp_path: Path, journal: Path) -> dict[str, str]:
    """Where the robot that writes down its commands is installed."""
    site = tmp_path / "site"
    site.mkdir()
    for source in ("journal_robot.py", "bars.py"):
        (site / source).write_text((SUPPORT / source).read_text())
    groups = {
        "bpn.tasks": {"bars": "journal_robot:spec"},
        "bpn.robots": {"journal": "journal_robot:JournalRobot"},
        "bpn.rewards": {"bar": "bars:rewards"},
    }
    install(site, "journal-robot", groups)
    return where_installed(site) | {JOURNAL: str(journal)}


def service(of: subprocess.Popen[bytes], module: str) -> int | None:
    """The process of a service; None while it is not there."""
    for process in psutil.Process(of.pid).children(recursive=True):
        try:
            if module in process.cmdline():
                return process.pid
        except psutil.Error:  # it has just ended
            continue
    return None


def commanded(entries: list[Entry]) -> list[int]:
    return [entry.argument for entry in entries if entry.call == "command"]


def test_whoever_is_killed_the_robot_is_commanded_to_stop_and_episodes_tell_what_was_commanded(
    environment: dict[str, str],
    journal: Path,
    command: Callable[..., list[str]],
    tmp_path: Path,
    wait_for: WaitFor,
) -> None:
    words = (
        "bars",
        "--pacing",
        "realtime",
        "--iterations",
        "1",
        "--episodes",
        str(EPISODES),
        "--epochs",
        "1",
    )
    run = subprocess.Popen(
        command("train", *words, "--hidden-units", "16", "--runs-dir", str(tmp_path / "runs")),
        env=environment, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    moments = random_moments()
    try:
        for victim in ("bpn_edge", "bpn_robot_sim", "bpn_shared.bus.router"):
            begun = len(commanded(read(journal)))
            steps = moments.randrange(3, 30)
            wait_for(
                lambda b=begun, s=steps: len(commanded(read(journal))) >= b + s,
                f"{steps} commands",
                120,
            )
            pid = service(run, victim)
            assert pid is not None
            before = len(read(journal))
            os.kill(pid, signal.SIGKILL)
            wait_for(
                lambda v=victim, p=pid: service(run, v) not in (p, None), f"another {victim}", 60
            )
            if victim == "bpn_shared.bus.router":  # robot and edge go on past it
                continue
            wait_for(
                lambda b=before: any(entry.call == "reset" for entry in read(journal)[b:]),
                "another episode",
                120,
            )
            entries = read(journal)[before:]
            until = next(i for i, entry in enumerate(entries) if entry.call == "reset")
            if victim == "bpn_robot_sim":
                first = next(entry for entry in entries if entry.pid != pid)
                assert first.call == "stop"
            else:
                assert entries[until - 1].call == "stop"
                # one action may have been on its way; then the robot holds, in every period until it stops
                holding = commanded(entries[:until])[2:]
                assert set(holding) <= {HOLD}
                assert len(holding) <= 2 + 1.0 / PERIOD_S * 2
        assert run.wait(240) == 0
    finally:
        run.kill()
        run.wait()
    entries = read(journal)
    assert entries[-1].call == "stop"
    resets = [i for i, entry in enumerate(entries) if entry.call == "reset"]
    played = {
        tuple(commanded(entries[begin:end]))
        for begin, end in zip(resets, [*resets[1:], len(entries)], strict=True)
    }
    stored = sorted(tmp_path.glob("runs/*/episodes/*.bpne"))
    assert len(stored) == EPISODES
    for path in stored:
        assert tuple(Episode.decode(path.read_bytes(), spec()).actions.tolist()) in played
