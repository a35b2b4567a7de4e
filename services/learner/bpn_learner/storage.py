"""Writes that a full or failing disk holds up: they wait for it, say so, and do not wait for ever."""

import errno
import threading
import time
from collections.abc import Callable

from bpn_shared.backoff import Backoff
from bpn_shared.waiting import WaitStatus

GIVE_UP_S = 600.0


class StorageError(RuntimeError):
    """The disk does not take what has to be kept; the message says what and why."""


class StorageStopped(Exception):  # noqa: N818
    """`stop` asked for an end while a write waited."""


def trouble(what: str, error: OSError) -> str:
    """What is waited for when this was refused."""
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    reason = error.strerror or str(error)
    return f"{'room on' if full else 'help with'} the disk: cannot write {what}: {reason}"


def insist(
    what: str,
    write: Callable[[], object],
    *,
    waiting: WaitStatus,
    stop: threading.Event,
    give_up_s: float = GIVE_UP_S,
    backoff: Backoff | None = None,
) -> None:
    """Writes, and tries again for as long as the disk refuses.

    Raises:
        StorageError: it has refused for `give_up_s`.
        StorageStopped: `stop` was set meanwhile.
    """
    backoff = backoff or Backoff(0.2, 10.0)
    deadline_s = time.monotonic() + give_up_s
    obstacle = ""
    while True:
        try:
            write()
        except OSError as error:
            obstacle = trouble(what, error)
        else:
            if obstacle:
                waiting.done()
            return
        if time.monotonic() > deadline_s:
            raise StorageError(f"gave up waiting for {obstacle}")
        waiting.set(obstacle)
        if stop.wait(backoff.next_s()):
            raise StorageStopped(obstacle)
