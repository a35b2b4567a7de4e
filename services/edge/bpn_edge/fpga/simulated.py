"""A core simulated by Verilator: the transport for which the driver does not need a board."""

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_edge.fpga.build import Build
from bpn_edge.fpga.transport import DeviceError, RefusedError
from bpn_edge.fpga.verilated import model_library

_REFUSED = 2
_PIXELS, _WEIGHTS = 0, 1
_CLOCKS_A_SECOND = 1_000_000
"""What a second of waiting is in simulated clocks, about what a machine simulates in one."""


class SimulatedCore:
    """A `Transport` to a core that runs while somebody asks it something, clock by clock.

    Args:
        build: of the core.
        seed: of the random gaps and delays, if there are any.
        library: a model that was made already, by default the cached one of that build.

    Raises:
        ConfigError: Verilator or a C++ compiler is missing, or fails.
    """

    def __init__(self, build: Build, *, seed: int = 0, library: Path | None = None) -> None:
        self.build = build
        self._library = _functions(library or model_library(build))
        self._model = ctypes.c_void_p(self._library.bpn_create(seed))

    def read(self, register: int) -> int:
        """See `Transport.read`."""
        value = ctypes.c_uint32()
        self._check(
            self._library.bpn_read(self._model, register, ctypes.byref(value)),
            f"reading 0x{register:03x}",
        )
        return value.value

    def write(self, register: int, value: int, *, strobes: int = 0xF) -> None:
        """See `Transport.write`."""
        self._check(
            self._library.bpn_write(self._model, register, value, strobes),
            f"writing 0x{register:03x}",
        )

    def send_frame(self, beats: npt.NDArray[np.uint8], *, last: bool = True) -> None:
        """See `Transport.send_frame`; `last` is whether TLAST is set."""
        self._feed(_PIXELS, np.ascontiguousarray(beats), last)

    def send_set(self, words: npt.NDArray[np.uint32], *, last: bool = True) -> None:
        """See `Transport.send_set`."""
        self._feed(_WEIGHTS, np.ascontiguousarray(words, "<u4").view(np.uint8).reshape(-1, 4), last)

    def wait_event(self, timeout_s: float) -> bool:
        """See `Transport.wait_event`."""
        return bool(
            self._library.bpn_run_to_interrupt(self._model, int(timeout_s * _CLOCKS_A_SECOND))
        )

    def dawdle(self, *, pixels: int = 0, weights: int = 0, registers: int = 0) -> None:
        """How many of 256 clocks are gaps, in each of the streams and at the registers."""
        self._library.bpn_dawdle(self._model, pixels, weights, registers)

    def run(self, clocks: int) -> None:
        """Lets time pass."""
        self._library.bpn_run(self._model, clocks)

    def reset(self) -> None:
        """Resets the core; what waits to be sent still waits."""
        self._library.bpn_reset(self._model)

    def unsent(self) -> tuple[int, int]:
        """Beats of pixels, and words of weights, that the core has not taken yet."""
        pixels, weights = (
            int(self._library.bpn_unsent(self._model, stream)) for stream in (_PIXELS, _WEIGHTS)
        )
        return pixels, weights

    def forget_unsent(self) -> None:
        """Takes back what was not sent yet."""
        for stream in (_PIXELS, _WEIGHTS):
            self._library.bpn_unfeed(self._model, stream)

    @property
    def clocks(self) -> int:
        """Since the core was made."""
        return int(self._library.bpn_clocks(self._model))

    def close(self) -> None:
        """See `Transport.close`."""
        model, self._model = self._model, ctypes.c_void_p()
        if model:
            self._library.bpn_destroy(model)

    def __del__(self) -> None:
        if hasattr(self, "_model"):
            self.close()

    def _feed(self, stream: int, beats: npt.NDArray[np.uint8], last: bool) -> None:
        self._library.bpn_feed(self._model, stream, beats.ctypes.data, len(beats), int(last))

    @staticmethod
    def _check(answer: int, what: str) -> None:
        if answer == _REFUSED:
            raise RefusedError(f"the core refuses {what}")
        if answer:
            raise DeviceError(f"the core does not answer: {what}")


def _functions(path: Path) -> Any:
    library = ctypes.CDLL(str(path))
    handle, u32, u64, size = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64, ctypes.c_size_t
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "bpn_create": (handle, [ctypes.c_uint]),
        "bpn_destroy": (None, [handle]),
        "bpn_reset": (None, [handle]),
        "bpn_write": (ctypes.c_int, [handle, u32, u32, u32]),
        "bpn_read": (ctypes.c_int, [handle, u32, ctypes.POINTER(u32)]),
        "bpn_feed": (None, [handle, ctypes.c_int, handle, size, ctypes.c_int]),
        "bpn_unsent": (size, [handle, ctypes.c_int]),
        "bpn_unfeed": (None, [handle, ctypes.c_int]),
        "bpn_dawdle": (None, [handle, ctypes.c_uint, ctypes.c_uint, ctypes.c_uint]),
        "bpn_run": (None, [handle, u64]),
        "bpn_run_to_interrupt": (ctypes.c_int, [handle, u64]),
        "bpn_clocks": (u64, [handle]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
