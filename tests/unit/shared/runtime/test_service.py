import json
import logging
import re
import subprocess
import sys

import pytest
from logged import lines

from bpn_shared.bus.traffic import Traffic
from bpn_shared.counters import Counters
from bpn_shared.runtime.service import new_worker_id, protocol_of
from bpn_shared.runtime.telemetry import Latencies, Reporter, WeightsTimeline
from bpn_shared.version import PROTOCOL
from bpn_shared.waiting import WaitStatus


def test_a_flood_of_refusals_is_counted_and_logged_by_powers_of_ten(
    caplog: pytest.LogCaptureFixture,
) -> None:
    counters = Counters()
    for _ in range(250):
        counters.refuse("frames_refused", "bad frame")
    assert counters.snapshot() == {"frames_refused": 250}
    assert len(lines(caplog, Counters)) == 3  # at 1, 10 and 100


def test_the_newest_reason_of_every_kind_of_refusal_is_kept() -> None:
    counters = Counters()
    counters.refuse("frames_refused", "of another size")
    counters.refuse("episodes_refused", "of another run")
    counters.refuse("frames_refused", "of another task")
    assert list(counters.reasons().items()) == [
        ("episodes_refused", "of another run"),
        ("frames_refused", "of another task"),
    ]


def test_waiting_is_said_once_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    waiting, counters = WaitStatus(), Counters()
    reporter = Reporter(
        "edge",
        "edge-1",
        lambda: (None, 3),
        Traffic(),
        waiting=waiting,
        counters=counters,
        latencies=Latencies(),
        weights=WeightsTimeline(),
    )
    waiting.set("a frame")
    waiting.set("a frame")
    assert lines(caplog, WaitStatus) == ["waiting for a frame"]
    counters.add("frames", 2)
    said = json.loads(reporter.answer(b""))
    assert (said["kind"], said["worker"], said["run"], said["slot"]) == ("edge", "edge-1", None, 3)
    assert (said["waiting_for"], said["counters"]) == ("a frame", {"frames": 2})
    waiting.done()
    assert json.loads(reporter.answer(b""))["waiting_for"] is None


def test_a_signal_while_the_main_thread_holds_the_events_lock_does_not_deadlock() -> None:
    program = """
import signal
from bpn_shared.runtime.service import stop_on_signals
stop = stop_on_signals()
with stop._cond:  # where every stop.wait() and stop.set() of the main thread is for a moment
    signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGTERM)
assert stop.wait(20)
print("stopped")
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "stopped\n"


def test_a_log_that_cannot_be_written_ends_nothing_and_tells_later() -> None:
    program = """
import logging, os, sys
from bpn_shared.runtime.service import set_up_logging
heard = []
class Elsewhere(logging.Handler):
    def emit(self, record):
        heard.append(record.getMessage())
log = os.dup(2)
os.dup2(os.open("/dev/full", os.O_WRONLY), 2)  # every write: no space left on device
set_up_logging("edge-0")
logging.getLogger().addHandler(Elsewhere())
for number in range(20):
    logging.warning("line %d", number)
assert [line for line in heard if "lost" in line] == ["log lines are lost: No space left on device"]
assert len(heard) == 21
os.dup2(log, 2)
logging.warning("there is space again")
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert "edge-0 WARNING there is space again\n" in done.stderr
    assert done.stderr.endswith(
        "edge-0 ERROR log lines were lost, up to 21: No space left on device\n"
    )
    assert "Traceback" not in done.stderr


def test_a_workers_id_tells_its_protocol() -> None:
    worker = new_worker_id("robot_sim")
    assert protocol_of(worker) == PROTOCOL
    assert re.fullmatch("robot-sim-p[0-9]+-[0-9a-f]{12}", worker)
    assert new_worker_id("robot_sim") != worker
    assert protocol_of("robot-sim-0123456789ab") is None
