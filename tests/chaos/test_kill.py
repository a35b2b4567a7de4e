"""kill -9 of each service in the middle of an iteration, one run, nothing lost and nothing changed."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from rich.console import Console

from bpn.local_run import execute, free_endpoint, new_run
from bpn.summary import summarize
from bpn.supervisor import Supervisor
from bpn_shared.config import RunConfig
from bpn_shared.run_folder import RunFolder

CONFIG = RunConfig.for_task(
    "reaching", seed=11, iterations=5, episodes=40, epochs=1, nodes=24, datasets=2
)
VICTIMS = ["edge-0", "robot-0", "learner", "router"]


def run_to_end(folder: RunFolder, on_started: Callable[[Supervisor], None]) -> None:
    execute(
        folder,
        endpoint=free_endpoint(),
        stop=threading.Event(),
        out=Console(quiet=True),
        on_started=on_started,
    )


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = new_run(tmp_path_factory.mktemp("runs"), CONFIG)
    run_to_end(folder, lambda _: None)
    sha256: str = summarize(folder)["weights_sha256"]
    return sha256


def test_every_service_may_die_in_the_middle_of_an_iteration(
    undisturbed: str, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    folder = new_run(tmp_path, CONFIG)
    started: list[Supervisor] = []
    run = threading.Thread(target=run_to_end, args=(folder, started.append))
    run.start()
    wait_for(lambda: started, "the supervisor")
    (supervisor,) = started
    for iteration, name in enumerate(VICTIMS):
        wait_for(
            lambda i=iteration: folder.episode_path(i, 4).exists(),
            f"the middle of iteration {iteration}",
            60,
        )
        pid = supervisor.service(name).pid
        assert pid is not None
        assert not folder.episode_path(iteration, CONFIG.episodes - 1).exists(), "not the middle"
        os.kill(pid, signal.SIGKILL)
        wait_for(
            lambda name=name, pid=pid: supervisor.service(name).pid not in (pid, None),
            f"{name} to be started again",
        )
    run.join(120)
    assert not run.is_alive(), "the run did not come to its end"
    summary = summarize(folder)
    assert [supervisor.service(name).restarts for name in VICTIMS] == [1, 1, 1, 1]
    assert summary["state"] == "finished"
    assert (summary["episodes_lost"], summary["episodes_duplicated"]) == (0, 0)
    assert summary["episodes"] == CONFIG.iterations * CONFIG.episodes
    assert summary["weights_sha256"] == undisturbed
    assert folder.state().attempt == 2


def test_when_the_supervisor_is_killed_its_services_end(
    tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "bpn", "train", "reaching", "--runs-dir", str(tmp_path)],
        stdout=subprocess.DEVNULL,
    )
    wait_for(lambda: list(tmp_path.glob("*/episodes/000000-*.bpne")), "the first episode", 60)
    services = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    wait_for(lambda: not any(alive(service) for service in services), "all services to end")


def alive(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
