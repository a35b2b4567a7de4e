import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn_shared import heartbeat
from bpn_shared.heartbeat import FILE_VARIABLE, Heartbeat

WaitFor = Callable[..., None]
HEALTHY = Path(__file__).parents[3] / "deploy" / "compose" / "healthy"


def is_healthy(file: Path) -> bool:
    done = subprocess.run([HEALTHY], env={**os.environ, FILE_VARIABLE: str(file)}, check=False)
    return done.returncode == 0


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FILE_VARIABLE, str(tmp_path / "heartbeat"))
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.01)
    return tmp_path / "heartbeat"


def test_it_beats_while_the_service_is_well(file: Path, wait_for: WaitFor) -> None:
    assert not is_healthy(file)
    well = True
    with Heartbeat(lambda: well):
        wait_for(file.exists, "the first beat")
        assert is_healthy(file)
        os.utime(file, (0, 0))
        wait_for(lambda: file.stat().st_mtime > 0, "another beat")
        well = False
        wait_for(lambda: os.utime(file, (0, 0)) or file.stat().st_mtime == 0, "the last beat")
        assert not is_healthy(file)
        well = True
        wait_for(lambda: file.stat().st_mtime > 0, "a beat when it is well again")


def test_it_ends_with_its_context(file: Path, wait_for: WaitFor) -> None:
    with Heartbeat():
        wait_for(file.exists, "the first beat")
    file.unlink()
    assert not file.exists()


def test_an_old_beat_is_not_healthy(file: Path) -> None:
    file.touch()
    os.utime(file, (file.stat().st_atime, file.stat().st_mtime - 11))
    assert not is_healthy(file)


def test_without_the_variable_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(FILE_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    with Heartbeat():
        pass
    assert not list(tmp_path.iterdir())
