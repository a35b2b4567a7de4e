"""Where a core is: what the driver needs of a simulated one, or of one behind mapped registers."""

from typing import Protocol

import numpy as np
import numpy.typing as npt


class DeviceError(RuntimeError):
    """The core does not answer as it should; the message says what it did."""


class RefusedError(DeviceError):
    """The core refused an access."""


class Transport(Protocol):
    """Registers, and two streams. One thread at a time may use it."""

    def read(self, register: int) -> int:
        """A register, by its offset in bytes.

        Raises:
            RefusedError: the core says no.
            DeviceError: it does not answer.
        """
        ...

    def write(self, register: int, value: int) -> None:
        """See `read`."""
        ...

    def send_frame(self, beats: npt.NDArray[np.uint8]) -> None:
        """Sends, or begins to send, a frame: uint8[beats, pixel bytes]; TLAST with the last beat."""
        ...

    def send_set(self, words: npt.NDArray[np.uint32]) -> None:
        """Sends, or begins to send, a weight set: uint32[n]; TLAST with the last word."""
        ...

    def wait_event(self, timeout_s: float) -> bool:
        """Whether the core raises its interrupt within the time; it counts until the events are cleared."""
        ...

    def close(self) -> None:
        """Gives the core back."""
        ...
