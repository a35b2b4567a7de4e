"""What may happen to a run without changing its result: kill -9 of each service, garbage on every key."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest
from moments import random_moments
from rich.console import Console

from bpn.local_run import execute, new_run, private_endpoint
from bpn.summary import summarize
from bpn.supervisor import Supervisor
from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.liveliness import Alive
from bpn_shared.bus.requests import RefusedError, request
from bpn_shared.bus.session import Bus
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task(
    "reaching", seed=11, iterations=5, episodes=40, epochs=1, hidden_units=24, replay_iterations=2
)
VICTIMS = ["edge-0", "robot-0", "learner", "router"]


def run_to_end(
    folder: RunFolder, on_started: Callable[[Supervisor], None], endpoint: str | None = None
) -> None:
    execute(
        folder,
        endpoint=endpoint or private_endpoint(),
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


def start(folder: RunFolder, wait_for: Callable[..., None]) -> tuple[threading.Thread, Supervisor]:
    """Who goes on with the run, and its services."""
    started: list[Supervisor] = []
    run = threading.Thread(target=run_to_end, args=(folder, started.append))
    run.start()
    wait_for(lambda: started, "the supervisor")
    return run, started[0]


def kill(supervisor: Supervisor, name: str, wait_for: Callable[..., None]) -> None:
    """kill -9, and the service is there again."""
    pid = supervisor.service(name).pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    wait_for(lambda: supervisor.service(name).pid not in (pid, None), f"{name} to be started again")


def test_every_service_may_die_in_the_middle_of_an_iteration(
    undisturbed: str, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    folder = new_run(tmp_path, CONFIG)
    run, supervisor = start(folder, wait_for)
    for iteration, name in enumerate(VICTIMS):
        wait_for(
            lambda i=iteration: folder.episode_path(i, 4).exists(),
            f"the middle of iteration {iteration}",
            60,
        )
        assert not folder.episode_path(iteration, CONFIG.episodes - 1).exists(), "not the middle"
        kill(supervisor, name, wait_for)
    run.join(120)
    assert not run.is_alive(), "the run did not come to its end"
    summary = summarize(folder)
    assert [supervisor.service(name).restarts for name in VICTIMS] == [1, 1, 1, 1]
    assert summary["state"] == "finished"
    assert (summary["episodes_lost"], summary["episodes_duplicated"]) == (0, 0)
    assert summary["episodes"] == CONFIG.iterations * CONFIG.episodes
    assert summary["weights_sha256"] == undisturbed
    assert folder.state().attempt == 2


def test_router_edge_and_robot_may_die_at_any_moment(
    undisturbed: str, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    """While frames and actions go past the router, and while they do not for a moment."""
    folder = new_run(tmp_path, CONFIG)
    run, supervisor = start(folder, wait_for)
    moments = random_moments()
    victims = 2 * ["edge-0", "robot-0", "router"]
    moments.shuffle(victims)
    for number, name in enumerate(victims):
        episodes = 30 * number + moments.randrange(1, 25)
        wait_for(
            lambda n=episodes: len(list(folder.path.glob("episodes/*.bpne"))) >= n,
            f"{episodes} episodes",
            120,
        )
        kill(supervisor, name, wait_for)
    run.join(180)
    assert not run.is_alive(), "the run did not come to its end"
    summary = summarize(folder)
    assert (summary["state"], summary["weights_sha256"]) == ("finished", undisturbed)
    assert (summary["episodes_lost"], summary["episodes_duplicated"]) == (0, 0)
    # each pair of robot and edge has found the shorter way: the first, and one after each death of either
    found = (folder.logs / "edge-0.log").read_text().count("is reached past the router")
    assert found >= 3


def test_garbage_on_every_key_is_refused_counted_and_changes_nothing(
    undisturbed: str, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    folder, endpoint = new_run(tmp_path, CONFIG), private_endpoint()
    run = threading.Thread(target=run_to_end, args=(folder, lambda _: None, endpoint))
    run.start()
    wait_for(folder.episode_path(0, 0).exists, "the first episode", 150)
    frame, action, weights = (
        keys.frame(folder.run, 0), keys.action(folder.run, 0), keys.weights(folder.run)
    )  # fmt: skip
    rng = np.random.default_rng(0)
    with Bus(endpoint) as bus:
        streams = [LatestPublisher(bus, key, "frame") for key in (frame, action, weights)]
        requests = [
            keys.next_episode(folder.run), keys.episode(folder.run), keys.reset(folder.run, 0)
        ]  # fmt: skip
        kinds = ("edge", "robot_sim", "learner")
        alive = {kind: Alive(bus, kind) for kind in kinds}
        wait_for(lambda: all(alive[kind].workers() for kind in kinds), "all workers' tokens")
        for _ in range(30):
            noise = rng.bytes(int(rng.integers(0, 9000)))
            for stream in streams:
                stream.put(noise, attachment=noise[:36])
            for key in requests:
                with pytest.raises(RefusedError):
                    request(bus, key, noise, timeout_s=10.0)

        def count(kind: str, counter: str) -> int:
            (worker,) = alive[kind].workers()
            report = json.loads(request(bus, keys.health(kind, worker), b"", timeout_s=10.0))
            return int(report["counters"].get(counter, 0))

        assert count("edge", "frames_refused") > 0
        assert count("edge", "weights_refused") > 0
        assert count("robot_sim", "actions_refused") > 0
        assert count("robot_sim", "requests_refused") == 30
        assert count("learner", "requests_refused") == 60
    run.join(120)
    assert not run.is_alive(), "the run did not come to its end"
    summary = summarize(folder)
    assert (summary["state"], summary["weights_sha256"]) == ("finished", undisturbed)
    assert folder.state().attempt == 1  # nobody had to be restarted


def test_when_the_supervisor_is_killed_its_services_end(
    tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "bpn", "train", "reaching", "--runs-dir", str(tmp_path)],
        stdout=subprocess.DEVNULL,
    )
    wait_for(lambda: list(tmp_path.glob("*/episodes/000000-*.bpne")), "the first episode", 150)
    services = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    wait_for(lambda: not any(alive(service) for service in services), "all services to end")


def alive(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
