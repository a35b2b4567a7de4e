import errno
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from logged import lines

from bpn_shared.runtime import heartbeat
from bpn_shared.runtime.heartbeat import FILE_VARIABLE, READY_SUFFIX, Heartbeat

WaitFor = Callable[..., None]
HEALTHY = Path(__file__).parents[4] / "deploy" / "compose" / "healthy"


def is_healthy(file: Path, *options: str) -> bool:
    done = subprocess.run(
        [HEALTHY, *options],
        env={**os.environ, FILE_VARIABLE: str(file)},
        stderr=subprocess.DEVNULL,
        check=False,
    )
    return done.returncode == 0


def uptime_s() -> float:
    return float(Path("/proc/uptime").read_text().split()[0])


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FILE_VARIABLE, str(tmp_path / "heartbeat"))
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.01)
    return tmp_path / "heartbeat"


def test_it_beats_whether_the_service_is_ready_or_not(file: Path, wait_for: WaitFor) -> None:
    ready = file.with_name(file.name + READY_SUFFIX)
    assert not is_healthy(file)
    is_ready = False
    with Heartbeat(lambda: is_ready) as beating:
        wait_for(file.exists, "the first beat")
        assert is_healthy(file)
        assert not is_healthy(file, "--ready")
        is_ready = True
        wait_for(ready.exists, "it to be ready")
        assert is_healthy(file, "--ready")
        beating.ready_when(lambda: False)
        wait_for(lambda: _aged(ready), "the last beat of readiness")
        assert not is_healthy(file, "--ready")
        assert is_healthy(file)


def _aged(file: Path) -> bool:
    """Writes an old time, and says whether nobody wrote a new one over it meanwhile."""
    old = f"{uptime_s() - 20:<20.2f}\n"
    file.write_text(old)
    threading.Event().wait(0.1)  # ten periods
    return file.read_text() == old


def test_it_ends_with_its_context(file: Path, wait_for: WaitFor) -> None:
    with Heartbeat():
        wait_for(file.exists, "the first beat")
    file.unlink()
    assert not file.exists()


@pytest.mark.parametrize(
    ("age_s", "healthy"), [(0.0, True), (8.0, True), (11.0, False), (3600.0, False), (-60.0, False)]
)
def test_an_old_beat_is_not_healthy_and_one_of_before_the_boot_neither(
    file: Path, age_s: float, healthy: bool
) -> None:
    file.write_text(f"{uptime_s() - age_s:.2f}\n")
    assert is_healthy(file) == healthy


@pytest.mark.parametrize("set_by_s", [-3600.0, 3600.0])
def test_the_wall_clock_does_not_matter(file: Path, set_by_s: float) -> None:
    file.write_text(f"{uptime_s() - 11:.2f}\n")
    os.utime(file, (file.stat().st_atime, file.stat().st_mtime + set_by_s))
    assert not is_healthy(file)
    file.write_text(f"{uptime_s():.2f}\n")
    os.utime(file, (file.stat().st_atime, file.stat().st_mtime + set_by_s))
    assert is_healthy(file)


@pytest.mark.parametrize("content", ["", "yesterday\n", "\n"])
def test_a_file_without_a_time_is_not_healthy(file: Path, content: str) -> None:
    file.write_text(content)
    assert not is_healthy(file)


def test_a_frozen_process_is_not_healthy(tmp_path: Path, wait_for: WaitFor) -> None:
    file = tmp_path / "heartbeat"
    program = "from bpn_shared.runtime.heartbeat import Heartbeat; Heartbeat(); input()"
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, FILE_VARIABLE: str(file)},
        stdin=subprocess.PIPE,
    )
    try:
        wait_for(lambda: is_healthy(file), "the first beat")
        process.send_signal(signal.SIGSTOP)
        wait_for(lambda: not is_healthy(file), "its end", 30)
        process.send_signal(signal.SIGCONT)
        wait_for(lambda: is_healthy(file), "another beat")
    finally:
        process.kill()
        process.wait(10)


def test_a_full_disk_is_said_once_and_outlived(
    file: Path,
    wait_for: WaitFor,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    file.symlink_to("/dev/full")  # every write: no space left on device

    def said() -> list[str]:
        return lines(caplog, Heartbeat)

    with Heartbeat():
        wait_for(said, "the line")
        threading.Event().wait(0.1)  # ten periods
        file.unlink()
        wait_for(lambda: is_healthy(file), "a beat when there is space again")
    assert said() == [f"no heartbeat: {os.strerror(errno.ENOSPC)}"]


def test_without_the_variable_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(FILE_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    with Heartbeat():
        pass
    assert not list(tmp_path.iterdir())
