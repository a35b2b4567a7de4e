"""A core whose registers are mapped: on a Zynq, /dev/uio* by the device tree, or /dev/mem at an address."""

import ctypes
import mmap
import os
import select
import time
import weakref

import numpy as np
import numpy.typing as npt

from bpn_edge.fpga import registers
from bpn_shared.spec.config import ConfigError

_SIZE = 4096


class MappedCore:
    """A `Transport` that pushes pixels and weights through registers, word by word, so that it needs no DMA.

    Args:
        path: the device.
        offset: of the registers in it.

    Raises:
        ConfigError: it cannot be opened or mapped.
    """

    def __init__(self, path: str, offset: int = 0) -> None:
        try:
            self._file = os.open(path, os.O_RDWR | os.O_SYNC)
        except OSError as error:
            raise ConfigError(f"kernel 'fpga' cannot open {path}: {error.strerror}") from error
        try:
            self._memory = mmap.mmap(self._file, _SIZE, offset=offset)
        except (OSError, ValueError, OverflowError) as error:
            os.close(self._file)
            raise ConfigError(
                f"kernel 'fpga' cannot map {path} at 0x{offset:x}: {error}"
            ) from error
        self._close_file = weakref.finalize(self, os.close, self._file)  # an edge makes one a run
        self._words = (ctypes.c_uint32 * (_SIZE // 4)).from_buffer(self._memory)
        self._interrupts = path.startswith("/dev/uio")

    def read(self, register: int) -> int:
        """See `Transport.read`; a refusal is a bus error, which ends the process: the driver asks for none."""
        return int(self._words[register // 4])

    def write(self, register: int, value: int) -> None:
        """See `Transport.write`."""
        self._words[register // 4] = value

    def send_frame(self, beats: npt.NDArray[np.uint8]) -> None:
        """See `Transport.send_frame`."""
        self._push(
            np.ascontiguousarray(beats).view("<u4").reshape(-1),
            registers.PIXELS,
            registers.PIXELS_LAST,
        )

    def send_set(self, words: npt.NDArray[np.uint32]) -> None:
        """See `Transport.send_set`."""
        self._push(words, registers.WEIGHTS, registers.WEIGHTS_LAST)

    def wait_event(self, timeout_s: float) -> bool:
        """See `Transport.wait_event`; asleep where the kernel has the interrupt, else it asks again and again."""
        deadline = time.monotonic() + timeout_s
        while not self._raised():
            left_s = deadline - time.monotonic()
            if left_s <= 0:
                return False
            if self._interrupts:
                os.write(self._file, (1).to_bytes(4, "little"))  # let the next one through
                if not self._raised() and select.select([self._file], [], [], left_s)[0]:
                    os.read(self._file, 4)
        return True

    def close(self) -> None:
        """See `Transport.close`."""
        del self._words
        self._memory.close()
        self._close_file()

    def _raised(self) -> bool:
        return bool(self.read(registers.EVENTS) & self.read(registers.INTERRUPT))

    def _push(self, words: npt.NDArray[np.uint32], to: int, to_last: int) -> None:
        *some, last = words.tolist()
        at = to // 4
        for word in some:
            self._words[at] = word
        self._words[to_last // 4] = last
