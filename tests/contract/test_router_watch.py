"""A router that is lost: said once, with the reason, counted, and the end of work that others could do."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from counting_proxy import CountingProxy
from logged import lines

from bpn_certificates.folders import make
from bpn_shared.bus.certificates import FOLDER_VARIABLE
from bpn_shared.bus.router_watch import RouterLostError, RouterWatch
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.waiting import WaitStatus

WaitFor = Callable[..., None]
RunningRouter = Callable[[str], contextlib.AbstractContextManager[None]]
PERIOD_S = 0.02


class Watched:
    """A session, and what its watch tells."""

    def __init__(self, bus: Bus) -> None:
        self.waiting, self.counters = WaitStatus(), Counters()
        self.watch = RouterWatch(
            bus, self.waiting, self.counters, period_s=PERIOD_S, say_after_s=3 * PERIOD_S
        )


def test_lost_and_back_are_one_line_each_however_long_it_takes(
    running_router: RunningRouter, free_tcp_endpoint: str, wait_for: WaitFor,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    with running_router(free_tcp_endpoint):
        bus = Bus(free_tcp_endpoint)
        watched = Watched(bus)
        wait_for(lambda: bus.connected, "the router")
    with contextlib.closing(bus), watched.watch:
        wait_for(
            lambda: "nobody listens" in (watched.waiting.snapshot()[0] or ""),
            "the loss to be known",
        )
        what, since_s = watched.waiting.snapshot()
        assert what is not None
        assert free_tcp_endpoint in what
        # one, or two if the router was just ending at the first look
        count = len(lines(caplog, RouterWatch))
        wait_for(lambda: watched.waiting.snapshot()[1] > since_s + 10 * PERIOD_S, "some looks")
        assert len(lines(caplog, RouterWatch)) == count <= 2
        with running_router(free_tcp_endpoint):
            wait_for(lambda: len(lines(caplog, RouterWatch)) > count, "the line that it is back")
            assert watched.waiting.snapshot() == (None, 0.0)
            *lost, back = lines(caplog, RouterWatch)
            assert all(line.startswith("lost the router") for line in lost)
            assert re.search("is back after [0-9]+ s", back)
            assert watched.counters.snapshot() == {"router_lost": 1}


def test_a_wait_that_was_there_before_is_there_after() -> None:
    waiting = WaitStatus()
    waiting.set("an episode")
    waiting.obstruct("the router")
    assert waiting.snapshot()[0] == "the router"
    waiting.obstruct(None)
    assert waiting.snapshot()[0] == "an episode"


@pytest.fixture
def line(endpoint: str) -> Iterator[CountingProxy]:
    """A line to the router that can be cut."""
    with CountingProxy(int(endpoint.rpartition(":")[2])) as proxy:
        yield proxy


def test_work_ends_when_the_line_is_cut_for_too_long_and_not_before(
    line: CountingProxy, wait_for: WaitFor
) -> None:
    bus = Bus(f"tcp/localhost:{line.port}")
    watched, stop = Watched(bus), threading.Event()

    def work() -> None:
        with watched.watch.holding_for(1.0, stop):
            line.cut()
            wait_for(lambda: watched.waiting.snapshot()[0], "the loss to be known")
            assert not stop.is_set()
            assert stop.wait(20)

    lost = pytest.raises(RouterLostError, match=r"is lost for [1-9][0-9]* s")
    with contextlib.closing(bus), watched.watch, lost:
        work()


def test_work_that_is_over_is_not_ended_later(line: CountingProxy) -> None:
    bus = Bus(f"tcp/localhost:{line.port}")
    watched, stop, later = Watched(bus), threading.Event(), threading.Event()
    with contextlib.closing(bus), watched.watch:
        with watched.watch.holding_for(0.1, stop):
            pass
        line.cut()
        with pytest.raises(RouterLostError), watched.watch.holding_for(0.1, later):
            assert later.wait(20)
        assert not stop.is_set()


FROZEN = """
import sys, threading
from bpn_shared.bus.router_watch import RouterLostError, RouterWatch
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.waiting import WaitStatus

stop = threading.Event()
with Bus(sys.argv[1]) as bus, RouterWatch(bus, WaitStatus(), Counters(), period_s=0.1) as watch:
    try:
        with watch.holding_for(float(sys.argv[2]), stop):
            print("working", flush=True)
            stop.wait(60)
    except RouterLostError as error:
        print(error, flush=True)
"""


def test_who_was_frozen_gives_up_although_its_clock_seems_right(
    endpoint: str,
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", FROZEN, endpoint, "5.5"], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "working\n"
    os.kill(process.pid, signal.SIGSTOP)
    threading.Event().wait(7.0)  # the fault itself: a process that stands still for so long
    os.kill(process.pid, signal.SIGCONT)
    assert re.fullmatch(r"this process stood still for [67] s\n", process.stdout.readline())
    assert process.wait(60) == 0


def test_a_machines_certificate_is_told_by_its_workers_too_which_need_none(
    running_router: RunningRouter,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    wait_for: WaitFor,
) -> None:
    make(tmp_path / "certificates", days=7, server_names=["localhost"])
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "certificates" / "edge"))
    endpoint = f"unixsock-stream/{tmp_path}/router.sock"
    with running_router(endpoint), Bus(endpoint) as bus, Watched(bus).watch as watch:
        wait_for(lambda: watch.certificate, "the certificate's life")
        life = watch.certificate
        assert life is not None
        assert timedelta(days=6) < life.left(datetime.now(UTC)) < timedelta(days=8)
