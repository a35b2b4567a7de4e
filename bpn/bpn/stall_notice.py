"""Says why a run makes no progress: once when that begins, again when the reason changes, once when it is over."""

import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.runtime.watchdog import STALLED_AFTER_S, Circumstances, Watchdog

_LEAST_FREE_BYTES = 64 * 1024 * 1024


class StallNotice:
    """One run's.

    Args:
        say: prints a line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said = ""
        self._for_s = 0.0

    def update(self, reason: str, for_s: float) -> None:
        """What the run waits for now, and for how long it has; no reason if it makes progress."""
        if reason and reason != self._said:
            stalled = for_s >= STALLED_AFTER_S  # less: it is in the queue
            self._say(f"{f'no progress for {for_s:.0f} s' if stalled else 'waiting'}: {reason}")
        elif self._said and not reason:
            self._say(f"goes on after {self._for_s:.0f} s")
        self._said, self._for_s = reason, for_s


class LocalStalls:
    """Watches a run whose services are ours alone, by what they report.

    Args:
        episode_steps: the most steps that an episode has.
        disk: a folder on the disk that the run is written to.
    """

    def __init__(self, episode_steps: int, disk: Path, notice: StallNotice) -> None:
        self._watchdog = Watchdog(episode_steps, time.monotonic())
        self._disk, self._notice = disk, notice
        self._lock = threading.Lock()

    def hear(self, report: Telemetry) -> None:
        """A service tells how it is. May be called on any thread."""
        with self._lock:
            self._watchdog.hear(report, time.monotonic())

    def look(self, iteration: int, *, connected: bool) -> str:
        """Says what there is to say; returns why there is no progress, empty where there is.

        Args:
            iteration: how many are on disk, or trials played.
            connected: whether the router is reached.
        """
        now_s = time.monotonic()
        around = Circumstances(
            router="" if connected else "the router is not reached", disk=self._disk_trouble()
        )
        with self._lock:
            self._watchdog.iterated(iteration, now_s)
            stall = self._watchdog.stall(now_s, around)
        reason, for_s = ("", 0.0) if stall is None else (stall.reason, stall.for_s)
        self._notice.update(reason, for_s)
        return reason

    def _disk_trouble(self) -> str:
        free_bytes = shutil.disk_usage(self._disk).free
        if free_bytes >= _LEAST_FREE_BYTES:
            return ""
        return f"the disk of {self._disk} is nearly full: {free_bytes // 2**20} MiB are left"
