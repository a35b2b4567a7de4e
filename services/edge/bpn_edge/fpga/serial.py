"""A core at the other end of a serial line: the ULX3S's shell (`services/edge/rtl/serial`)."""

import os
import select
import struct
import termios
import time
import weakref
from typing import Protocol

import numpy as np
import numpy.typing as npt

from bpn_edge.fpga import registers
from bpn_edge.fpga.transport import DeviceError, RefusedError
from bpn_shared.spec.config import ConfigError

BAUD = 3_000_000
_ANSWER_S = 2.0
_REFUSED = 2


class Line(Protocol):
    """A line of bytes."""

    def write(self, data: bytes) -> None: ...

    def read(self, count: int, timeout_s: float) -> bytes:
        """That many bytes, or those that came within the time."""
        ...

    def close(self) -> None: ...


class SerialCore:
    """A `Transport` over a line."""

    def __init__(self, line: Line) -> None:
        self._line = line

    def read(self, register: int) -> int:
        """See `Transport.read`."""
        answer, value = struct.unpack("<BI", self._ask(b"R" + struct.pack("<H", register), 5))
        _check(answer, f"reading 0x{register:03x}")
        return int(value)

    def write(self, register: int, value: int) -> None:
        """See `Transport.write`."""
        answer = self._ask(b"W" + struct.pack("<HI", register, value), 1)
        _check(answer[0], f"writing 0x{register:03x}")

    def send_frame(self, beats: npt.NDArray[np.uint8]) -> None:
        """See `Transport.send_frame`."""
        self._stream(registers.PIXELS, np.ascontiguousarray(beats).view("<u4").reshape(-1))

    def send_set(self, words: npt.NDArray[np.uint32]) -> None:
        """See `Transport.send_set`."""
        self._stream(registers.WEIGHTS, words)

    def wait_event(self, timeout_s: float) -> bool:
        """See `Transport.wait_event`."""
        deadline = time.monotonic() + timeout_s
        while not self.read(registers.EVENTS) & self.read(registers.INTERRUPT):
            if time.monotonic() > deadline:
                return False
        return True

    def close(self) -> None:
        """See `Transport.close`."""
        self._line.close()

    def _stream(self, register: int, words: npt.NDArray[np.uint32]) -> None:
        command = b"S" + struct.pack("<HI", register, len(words)) + words.astype("<u4").tobytes()
        _check(
            self._ask(command, 1, more_s=len(command) * 10 / BAUD)[0],
            f"a stream into 0x{register:03x}",
        )

    def _ask(self, command: bytes, count: int, more_s: float = 0.0) -> bytes:
        self._line.write(command)
        answer = self._line.read(count, _ANSWER_S + more_s)
        if len(answer) < count:
            raise DeviceError(
                f"the core at the line answers {len(answer)} of {count} bytes: "
                "is its bitstream loaded, of the same version?"
            )
        return answer


class Tty:
    """A `Line` that is a terminal device of this machine, such as /dev/ttyUSB0.

    Raises:
        ConfigError: it cannot be opened, or is no serial line.
    """

    def __init__(self, path: str) -> None:
        try:
            self._file = os.open(path, os.O_RDWR | os.O_NOCTTY)
        except OSError as error:
            raise ConfigError(f"kernel 'fpga' cannot open {path}: {error.strerror}") from error
        try:
            mode = termios.tcgetattr(self._file)
            mode[0:4] = [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0]
            mode[4] = mode[5] = termios.B3000000
            termios.tcsetattr(self._file, termios.TCSANOW, mode)
            termios.tcflush(self._file, termios.TCIOFLUSH)
        except termios.error as error:
            os.close(self._file)
            raise ConfigError(
                f"kernel 'fpga': {path} is no serial line of {BAUD} baud: {error.args[-1]}"
            ) from error
        self._close_file = weakref.finalize(self, os.close, self._file)  # an edge makes one a run

    def write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self._file, data) :]

    def read(self, count: int, timeout_s: float) -> bytes:
        got, deadline = b"", time.monotonic() + timeout_s
        while len(got) < count:
            left_s = deadline - time.monotonic()
            if left_s <= 0 or not select.select([self._file], [], [], left_s)[0]:
                break
            got += os.read(self._file, count - len(got))
        return got

    def close(self) -> None:
        self._close_file()


def _check(answer: int, what: str) -> None:
    if answer == _REFUSED:
        raise RefusedError(f"the core refuses {what}")
    if answer:
        raise DeviceError(f"the core answers {answer} to {what}")
