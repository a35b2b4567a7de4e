"""An event that resets itself when it was waited for."""

import threading


class Signal:
    """Wakes the one thread that waits for it, now or the next time; told twice meanwhile, it wakes it once.

    Anyone tells, one thread waits. It is a bare lock, whose `acquire` is one call into C: where a robot and the
    network share a core, every instruction before going to sleep delays what was just sent.
    """

    def __init__(self) -> None:
        self._untold = threading.Lock()  # held while there is nothing to tell
        self._untold.acquire()
        self._telling = threading.Lock()  # two that release at once would release one lock twice

    def tell(self) -> None:
        """Lets the waiting thread go on, or the next one that waits."""
        with self._telling:
            if self._untold.locked():
                self._untold.release()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Waits until there was something to tell since the last time; False: not within the timeout."""
        return self._untold.acquire(timeout=-1 if timeout_s is None else max(0.0, timeout_s))
