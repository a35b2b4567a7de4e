"""A core's device is given back, also by who only lets go of the core: an edge makes one for each run."""

import gc
import os
import pty
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn_edge.fpga import sources, verilated
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.mapped import MappedCore
from bpn_edge.fpga.serial import SerialCore, Tty
from bpn_edge.fpga.transport import Transport
from bpn_shared.spec.config import ConfigError


@pytest.fixture
def device(tmp_path: Path) -> Path:
    path = tmp_path / "device"
    path.write_bytes(bytes(4096))
    return path


@pytest.fixture
def line() -> str:
    return os.ttyname(pty.openpty()[1])


def open_files(path: str) -> int:
    links = Path("/proc/self/fd")
    return sum(os.path.realpath(f"/proc/self/fd/{n}") == path for n in os.listdir(links))


@pytest.mark.parametrize("closed", [True, False])
def test_a_mapped_core_leaves_no_file_open(device: Path, closed: bool) -> None:
    _leaves_none(lambda: MappedCore(str(device)), str(device), closed=closed)


@pytest.mark.parametrize("closed", [True, False])
def test_a_serial_core_leaves_no_file_open(line: str, closed: bool) -> None:
    _leaves_none(lambda: SerialCore(Tty(line)), line, closed=closed)


def test_an_address_beyond_all_memory_is_refused(device: Path) -> None:
    with pytest.raises(ConfigError, match="cannot map"):
        MappedCore(str(device), 1 << 80)


def test_models_that_nobody_used_for_long_are_removed(tmp_path: Path) -> None:
    """The newest stay; so does what is being made, and goes what was left by a process that is no more."""
    for number in range(40):
        (tmp_path / f"{number}.so").touch()
        os.utime(tmp_path / f"{number}.so", (number, number))
    (tmp_path / ".making-now").mkdir()
    (tmp_path / ".making-then/deep").mkdir(parents=True)
    os.utime(tmp_path / ".making-then", (0, 0))
    verilated.prune(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        ".making-now",
        *(f"{number}.so" for number in range(8, 40)),
    }


def test_a_model_that_is_there_needs_no_tools(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a container, where it is mounted, and may not be touched."""
    monkeypatch.setenv(verilated.CACHE, str(tmp_path))
    monkeypatch.setattr(verilated.importlib.util, "find_spec", lambda _: None)
    monkeypatch.setattr(verilated.shutil, "which", lambda _: None)
    assert not verilated.is_possible()
    with pytest.raises(ConfigError, match=r"needs a C\+\+ compiler"):
        verilated.model_library(Build())
    model = verilated._made_of(Build(), verilated.CORE, sources.folder())[1]
    model.touch()

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError

    monkeypatch.setattr(Path, "touch", refuse)
    assert verilated.is_possible()
    assert verilated.model_library(Build()) == model


def _leaves_none(make: Callable[[], Transport], path: str, *, closed: bool) -> None:
    before = open_files(path)
    core = make()
    assert open_files(path) > before
    if closed:
        core.close()
    del core
    gc.collect()
    assert open_files(path) == before
