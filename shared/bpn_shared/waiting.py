"""What a service waits for: a wait that nobody hears of looks like a service that does nothing."""

import logging
import time

log = logging.getLogger(__name__)


class WaitStatus:
    """What a service waits for: logged once when it changes, and part of its health report."""

    def __init__(self) -> None:
        self._what: str | None = None
        self._since_s = time.monotonic()
        self._obstacle: tuple[str, float] | None = None

    def set(self, what: str) -> None:
        """From now on the service waits for this."""
        if what != self._what:
            log.info("waiting for %s", what)
            self._what, self._since_s = what, time.monotonic()

    def done(self) -> None:
        """The service goes on."""
        if self._what is not None:
            log.info(
                "no longer waiting for %s (%.1f s)", self._what, time.monotonic() - self._since_s
            )
            self._what = None

    def obstruct(self, what: str | None) -> None:
        """Names what keeps the service from anything else, such as a lost router; None: nothing does.

        It is not logged: who knows it has said it.
        """
        self._obstacle = None if what is None else (what, time.monotonic())

    def snapshot(self) -> tuple[str | None, float]:
        """What the service waits for, and for how many seconds it has."""
        if (obstacle := self._obstacle) is not None:
            return obstacle[0], time.monotonic() - obstacle[1]
        what, since_s = self._what, self._since_s
        return what, time.monotonic() - since_s if what else 0.0
