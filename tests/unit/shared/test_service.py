import json
import logging
import subprocess
import sys

import pytest

from bpn_shared.service import Counters, Waiting, health_report


def test_a_flood_of_refusals_is_counted_and_logged_by_powers_of_ten(
    caplog: pytest.LogCaptureFixture,
) -> None:
    counters = Counters()
    for _ in range(250):
        counters.refuse("frames_refused", "bad frame")
    assert counters.snapshot() == {"frames_refused": 250}
    assert len(caplog.records) == 3  # at 1, 10 and 100


def test_waiting_is_said_once_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    waiting, counters = Waiting(), Counters()
    report = health_report("edge", waiting, counters)
    waiting.set("a frame")
    waiting.set("a frame")
    assert [r.message for r in caplog.records] == ["waiting for a frame"]
    counters.add("frames", 2)
    said = json.loads(report(b""))
    assert (said["waiting_for"], said["counters"]) == ("a frame", {"frames": 2})
    waiting.done()
    assert json.loads(report(b""))["waiting_for"] is None


def test_a_storm_of_signals_cannot_deadlock_a_waiting_process() -> None:
    # The main thread takes and releases the event's lock all the time while signals come in. With
    # `Event.set` in the handler this hangs.
    program = """
import os, signal, threading
from bpn_shared.service import stop_on_signals
stop = stop_on_signals()
def storm():
    for _ in range(2000):
        os.kill(os.getpid(), signal.SIGTERM)
thread = threading.Thread(target=storm)
thread.start()
while thread.is_alive() or not stop.is_set():
    stop.wait(0)
    stop.set()
print("stopped")
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "stopped\n"
