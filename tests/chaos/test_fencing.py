"""A learner is frozen, another takes its run over, the first one thaws: it writes nothing more."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn.local_run import new_run, private_endpoint, run_to_end
from bpn.summary import summarize
from bpn.supervisor import Supervisor, services_of_run
from bpn_shared.runs import lock
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runtime.worker import EXIT_UNRECOVERABLE
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task(
    "reaching",
    seed=5,
    iterations=40,
    episodes=2,
    steps=2,
    epochs=2,
    batch_size=2,
    hidden_units=1,
    replay_iterations=2,
)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = new_run(tmp_path_factory.mktemp("whole"), CONFIG)
    run_to_end(folder, endpoint=private_endpoint(), stop=threading.Event())
    sha256: str = summarize(folder)["weights_sha256"]
    return sha256


def remove_lock(folder: RunFolder) -> None:
    """As where a lease of the network file system ends, or it has no locks."""
    (folder.path / ".lock").unlink()


def let_it_be_silent(folder: RunFolder) -> None:
    """As if it had been frozen for longer."""
    os.utime(folder.path / ".lock", (0, time.time() - lock.SILENT_S - 1))


@pytest.mark.parametrize("open_up", [remove_lock, let_it_be_silent])
def test_a_frozen_learner_that_was_replaced_writes_nothing_when_it_thaws(
    undisturbed: str,
    open_up: Callable[[RunFolder], None],
    tmp_path: Path,
    wait_for: Callable[..., None],
) -> None:
    folder, endpoint = new_run(tmp_path, CONFIG), private_endpoint()
    supervisor = Supervisor(services_of_run(folder.run, CONFIG, tmp_path, endpoint), folder.logs)
    supervisor.start()
    second = None
    try:
        first = supervisor.service("learner").process
        assert first is not None
        wait_for(lambda: len(folder.metrics()) > 2, "the first learner's iterations", 150)
        first.send_signal(signal.SIGSTOP)
        open_up(folder)
        second = subprocess.Popen(
            [
                sys.executable, "-m", "bpn_learner", "--run", str(folder.run), "--connect",
                endpoint, "--runs-dir", str(tmp_path),
            ]
        )  # fmt: skip
        wait_for(lambda: attempts(folder)[-1] == 2, "the second learner's iterations", 150)
        assert folder.state().state == "running", "the run is over too early"
        first.send_signal(signal.SIGCONT)
        assert first.wait(60) == EXIT_UNRECOVERABLE
        assert second.wait(120) == 0
    finally:
        if second is not None:
            second.kill()
            second.wait()
        supervisor.stop()
    assert (
        "this learner, of attempt 1, writes nothing more"
        in (folder.logs / "learner.log").read_text()
    )
    assert attempts(folder) == sorted(attempts(folder))
    assert (folder.state().state, folder.state().attempt) == ("finished", 2)
    summary = summarize(folder)
    assert (summary["iterations"], summary["episodes_lost"]) == (CONFIG.iterations, 0)
    assert summary["weights_sha256"] == undisturbed


def attempts(folder: RunFolder) -> list[int]:
    """Of all lines, in the order of the file."""
    lines = (folder.path / "metrics.jsonl").read_bytes().splitlines()
    return [json.loads(line)["attempt"] for line in lines]
