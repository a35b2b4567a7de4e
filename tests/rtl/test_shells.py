"""The driver at the core's other doors: a serial line, simulated with its shell, and mapped registers."""

import ctypes
import os
import pty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bpn.testing.kernel import assert_exact, make_image
from bpn_edge.fpga import connected, packing, registers
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.device import Device
from bpn_edge.fpga.mapped import MappedCore
from bpn_edge.fpga.serial import SerialCore, Tty
from bpn_edge.fpga.transport import DeviceError, RefusedError
from bpn_edge.fpga.verilated import SERIAL, model_library
from bpn_edge.kernel import load
from bpn_edge.kernel.device_bank import DeviceBank
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.network import NetworkSpec

SPEC = NetworkSpec(1, 20, 3)


class SimulatedLine:
    """The line of the ULX3S's shell, simulated bit by bit."""

    def __init__(self) -> None:
        self._library = ctypes.CDLL(str(model_library(Build(), SERIAL)))
        self._library.bpn_serial_create.restype = ctypes.c_void_p
        self._library.bpn_serial_receive.restype = ctypes.c_size_t
        self._model = ctypes.c_void_p(self._library.bpn_serial_create())

    def write(self, data: bytes) -> None:
        self._library.bpn_serial_send(self._model, data, ctypes.c_size_t(len(data)))

    def read(self, count: int, timeout_s: float) -> bytes:
        buffer = ctypes.create_string_buffer(count)
        clocks = ctypes.c_uint64(int(timeout_s * 1_000_000))
        got = self._library.bpn_serial_receive(self._model, buffer, ctypes.c_size_t(count), clocks)
        return buffer.raw[:got]

    def close(self) -> None:
        self._library.bpn_serial_destroy(self._model)


@pytest.fixture
def line() -> Iterator[SimulatedLine]:
    line = SimulatedLine()
    yield line
    line.close()


def test_a_policy_over_the_serial_line(line: SimulatedLine) -> None:
    rng = np.random.default_rng(0)
    kernel = DeviceBank("fpga", Device(SerialCore(line)))
    for bank in (kernel, kernel.other_bank()):
        assert_exact(bank, WeightBlob.random(SPEC, rng), make_image("random", SPEC, rng))


def test_the_serial_line_says_what_is_refused(line: SimulatedLine) -> None:
    core = SerialCore(line)
    with pytest.raises(RefusedError):
        core.write(registers.SELECT, 1)
    with pytest.raises(RefusedError):
        core.read(0x3F0)
    line.write(b"\x00xyz")  # no command: passed over
    words = packing.weight_set(
        Build(), WeightBlob.random(SPEC, np.random.default_rng(0)), bank=0, epoch=5
    )
    core.send_set(words)
    assert core.read(registers.BANK_EPOCH) == 5
    assert core.read(registers.BANK_CRC) == words[-1]


def test_a_line_that_is_silent_is_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pty.openpty()
    line = Tty(os.ttyname(theirs))
    try:
        with pytest.raises(DeviceError, match="0 of 5 bytes: is its bitstream loaded"):
            SerialCore(line).read(registers.IDENTITY)
        monkeypatch.setenv(connected.WHERE, os.ttyname(theirs))
        with pytest.raises(ConfigError, match="kernel 'fpga': the core at the line answers 0 of 5"):
            load("fpga")
    finally:
        line.close()
        os.close(ours)
        os.close(theirs)


def test_no_device_is_one_clear_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(connected.WHERE, raising=False)
    monkeypatch.setattr(connected, "UIO", tmp_path)
    with pytest.raises(ConfigError, match="no UIO device is called bpn"):
        load("fpga")
    for where, words in (
        (str(tmp_path / "none"), "cannot open .*none: No such file"),
        (f"{tmp_path / 'short'}@0x1000", "cannot map"),
        ("/dev/mem@here", "'here' is no address"),
        ("/dev/tty-none", "cannot open /dev/tty-none: No such file"),
    ):
        (tmp_path / "short").write_bytes(b"1")
        monkeypatch.setenv(connected.WHERE, where)
        with pytest.raises(ConfigError, match=words):
            load("fpga")


def test_what_is_mapped_has_to_be_this_core(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    registers_file = tmp_path / "registers"
    registers_file.write_bytes(bytes(4096))
    monkeypatch.setenv(connected.WHERE, str(registers_file))
    with pytest.raises(ConfigError, match="identity 0x00000000, this driver's is 0x42500001"):
        load("fpga")


def test_a_core_of_impossible_sizes_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    registers_file = tmp_path / "registers"
    words = np.zeros(1024, "<u4")
    words[registers.IDENTITY // 4] = 0x4250_0001
    registers_file.write_bytes(words.tobytes())
    monkeypatch.setenv(connected.WHERE, str(registers_file))
    with pytest.raises(ConfigError, match="built for what no core is: pixel_bytes = 0"):
        load("fpga")


def test_mapped_words_are_where_the_map_has_them(tmp_path: Path) -> None:
    path = tmp_path / "registers"
    path.write_bytes(np.arange(1024, dtype="<u4").tobytes())
    core = MappedCore(str(path))
    assert core.read(registers.FRAMES) == registers.FRAMES // 4
    core.write(registers.SELECT, 2)
    core.send_set(np.array([7, 8, 9], np.uint32))
    core.close()
    words = np.frombuffer(path.read_bytes(), "<u4")
    assert words[registers.SELECT // 4] == 2
    assert (words[registers.WEIGHTS // 4], words[registers.WEIGHTS_LAST // 4]) == (8, 9)
