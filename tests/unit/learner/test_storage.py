"""Writes wait for room, say so, and do not wait for ever."""

import errno
import os
import threading

import pytest

from bpn_learner.storage import StorageError, StorageStopped, insist
from bpn_shared.backoff import Backoff
from bpn_shared.waiting import WaitStatus

QUICK = Backoff(0.001, 0.001)


class Disk:
    """One that refuses some times."""

    def __init__(self, refusals: int, number: int = errno.ENOSPC) -> None:
        self.refusals, self.number, self.tries = refusals, number, 0
        self.waited_for: list[str | None] = []
        self.waiting = WaitStatus()

    def write(self) -> None:
        self.tries += 1
        self.waited_for.append(self.waiting.snapshot()[0])
        if self.tries <= self.refusals:
            raise OSError(self.number, os.strerror(self.number))


def test_a_write_waits_for_room_and_says_so() -> None:
    disk = Disk(refusals=3)
    insist("metrics", disk.write, waiting=disk.waiting, stop=threading.Event(), backoff=QUICK)
    reason = "room on the disk: cannot write metrics: No space left on device"
    assert disk.waited_for == [None, reason, reason, reason]
    assert disk.waiting.snapshot()[0] is None


def test_a_write_that_succeeds_leaves_what_is_waited_for_alone() -> None:
    disk = Disk(refusals=0)
    disk.waiting.set("something else")
    insist("metrics", disk.write, waiting=disk.waiting, stop=threading.Event())
    assert disk.waiting.snapshot()[0] == "something else"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EACCES, errno.EROFS])
def test_the_wait_has_an_end_that_names_the_reason(number: int) -> None:
    disk = Disk(refusals=10**9, number=number)
    with pytest.raises(StorageError, match=f"gave up waiting for .*metrics: {os.strerror(number)}"):
        insist(
            "metrics", disk.write, waiting=disk.waiting, stop=threading.Event(), backoff=QUICK,
            give_up_s=0.02,
        )  # fmt: skip
    assert disk.tries > 1


def test_who_is_stopped_does_not_wait_but_tries_once() -> None:
    stop = threading.Event()
    stop.set()
    disk = Disk(refusals=1)
    with pytest.raises(StorageStopped):
        insist("metrics", disk.write, waiting=disk.waiting, stop=stop)
    insist("metrics", disk.write, waiting=disk.waiting, stop=stop)
    assert disk.tries == 2
