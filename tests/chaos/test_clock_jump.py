"""The wall clock jumps by a day, forth and back, in the middle of a run.

A container's clock is its machine's, and setting that would be a fault to everything on it. So the services run
with a `time` module that jumps: what our own code makes of the clock is disturbed, what compiled libraries
read from the kernel is not.
"""

import itertools
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from bpn.local_run import execute, new_run, private_endpoint
from bpn.summary import summarize
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

DAY_S = 86_400
CONFIG = RunConfig.for_task(
    "reaching", seed=13, iterations=6, episodes=8, epochs=1, hidden_units=24, replay_iterations=2
)
JUMPING = """
import os, time
from pathlib import Path

_offset, _time, _time_ns = Path(os.environ["BPN_TEST_CLOCK"]), time.time, time.time_ns
time.time = lambda: _time() + int(_offset.read_text())
time.time_ns = lambda: _time_ns() + int(_offset.read_text()) * 10**9
"""


def run_to_end(folder: RunFolder) -> None:
    execute(folder, endpoint=private_endpoint(), stop=threading.Event(), out=Console(quiet=True))


def episodes(folder: RunFolder) -> int:
    return len(list(folder.path.glob("episodes/*.bpne")))


def test_the_clock_jumps_by_a_day_forth_and_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wait_for: Callable[..., None]
) -> None:
    undisturbed = new_run(tmp_path / "undisturbed", CONFIG)
    run_to_end(undisturbed)

    clock = tmp_path / "offset_s"
    clock.write_text("0")
    (tmp_path / "sitecustomize.py").write_text(JUMPING)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    monkeypatch.setenv("BPN_TEST_CLOCK", str(clock))
    folder = new_run(tmp_path / "disturbed", CONFIG)
    run = threading.Thread(target=run_to_end, args=(folder,))
    run.start()
    for iterations, offset_s in ((1, DAY_S), (3, -DAY_S)):
        wait_for(lambda i=iterations: len(folder.metrics()) >= i, "the next jump's moment", 120)
        new = clock.with_suffix(".new")
        new.write_text(str(offset_s))
        new.replace(clock)
        stored, start_s = episodes(folder), time.monotonic()
        wait_for(lambda n=stored: episodes(folder) > n, "an episode after the jump", 120)
        print(
            f"JUMP of {offset_s / 3600:+.0f} h: {time.monotonic() - start_s:.2f} s to the next episode"
        )
    run.join(120)
    assert not run.is_alive(), "the run did not come to its end"

    summary = summarize(folder)
    assert (summary["state"], folder.state().attempt) == ("finished", 1)
    assert (summary["episodes_lost"], summary["episodes_duplicated"]) == (0, 0)
    assert summary["weights_sha256"] == summarize(undisturbed)["weights_sha256"]
    times = [record["time_unix_s"] for record in folder.metrics()]
    steps = [later - earlier for earlier, later in itertools.pairwise(times)]
    assert max(steps) > DAY_S / 2, "no jump forth"
    assert min(steps) < -DAY_S, "no jump back"
