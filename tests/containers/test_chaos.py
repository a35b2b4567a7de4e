"""What may happen to containers during a run without changing its result: every fault, and then the same weights.

`make test-chaos` runs these. Each fault hits a run in its middle; how long it takes until the next episode is
stored is printed, which is where ARCHITECTURE.md has its seconds from.
"""

import os
import random
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator

import pytest
from chaos import LONG, RUN_TIMEOUT_S, Progress, facts, kill_main, report
from compose_project import Project, docker

from bpn_shared.access import ROLES

pytestmark = pytest.mark.skipif("BPN_CHAOS" not in os.environ, reason="run `make test-chaos`")

SERVICES = ("router", *ROLES)
KILLS = int(os.environ.get("BPN_CHAOS_KILLS", "50"))


@pytest.fixture(scope="module")
def undisturbed(project: Project) -> dict[str, object]:
    run = project.start_run(**LONG)
    project.wait_finished(run, RUN_TIMEOUT_S)
    return facts(project, run)


@pytest.fixture
def disturbed(
    project: Project, undisturbed: dict[str, object]
) -> Iterator[Callable[..., tuple[str, Progress]]]:
    """Starts a run and waits for its middle; at the end it must equal the undisturbed one."""
    started: list[str] = []

    def start(victim: str) -> tuple[str, Progress]:
        run = project.start_run(**LONG)
        started.append(run)
        progress = Progress(project, run, victim)
        progress.wait_beyond(50, RUN_TIMEOUT_S)
        return run, progress

    yield start
    for run in started:
        project.wait_finished(run, RUN_TIMEOUT_S)
        found = facts(project, run)
        assert (found["lost"], found["duplicated"]) == (0, 0)
        assert found == undisturbed


Disturbed = Callable[[str], tuple[str, Progress]]


@pytest.mark.parametrize("service", SERVICES)
def test_kill_9(project: Project, disturbed: Disturbed, service: str) -> None:
    _, progress = disturbed(service)
    (container,) = project.containers(service)
    before, start_s = progress.episodes(), time.monotonic()
    kill_main(container)
    report(f"kill -9 {service}", progress, before + 1, start_s)


def test_the_router_is_restarted(project: Project, disturbed: Disturbed) -> None:
    _, progress = disturbed("router")
    before, start_s = progress.episodes(), time.monotonic()
    project.compose("restart", "router")
    report("router restarted", progress, before + 1, start_s)


@pytest.mark.parametrize("service", ["router", "edge", "learner"])
def test_frozen_for_8_s(project: Project, disturbed: Disturbed, service: str) -> None:
    _, progress = disturbed(service)
    (container,) = project.containers(service)
    docker("pause", container)
    time.sleep(8)  # the fault itself
    before, start_s = progress.episodes(), time.monotonic()
    docker("unpause", container)
    report(f"{service} frozen for 8 s, after its thawing", progress, before, start_s)


@pytest.mark.parametrize("service", ["edge", "learner"])
def test_without_network_for_15_s(project: Project, disturbed: Disturbed, service: str) -> None:
    _, progress = disturbed(service)
    (container,) = project.containers(service)
    network = f"{project.name}_bus"
    docker("network", "disconnect", network, container)
    time.sleep(15)  # the fault itself
    before, start_s = progress.episodes(), time.monotonic()
    docker("network", "connect", "--alias", service, network, container)
    report(f"{service} without network for 15 s, after its return", progress, before, start_s)


@pytest.mark.skipif(
    os.geteuid() != 0 or not shutil.which("nsenter") or not shutil.which("iptables"),
    reason="dropping packets needs root, nsenter and iptables beside the engine",
)
def test_30_percent_of_packets_lost(project: Project, disturbed: Disturbed) -> None:
    _, progress = disturbed("edge")
    (container,) = project.containers("edge")
    inside = ["nsenter", "-t", str(project.state(container)["Pid"]), "-n", "iptables"]
    rule = ["INPUT", "-m", "statistic", "--mode", "random", "--probability", "0.3", "-j", "DROP"]
    before, start_s = progress.episodes(), time.monotonic()
    subprocess.run([*inside, "-A", *rule], check=True, timeout=10)
    time.sleep(10)  # the fault itself
    print(f"PACKET LOSS: {progress.episodes() - before} episodes in 10 s")
    subprocess.run([*inside, "-D", *rule], check=True, timeout=10)
    report("30 % packet loss for 10 s, from its begin", progress, before, start_s)


def test_a_storm_of_sigterm(project: Project, disturbed: Disturbed) -> None:
    _, progress = disturbed("edge")
    before, start_s = progress.episodes(), time.monotonic()
    for _ in range(3):
        for service in ("edge", "robot_sim", "learner"):
            for container in project.containers(service):
                docker("exec", container, "bash", "-c", "kill $(cat /proc/1/task/1/children)")
    report("three rounds of SIGTERM to all workers", progress, before + 1, start_s)


def test_many_kills_in_random_order(project: Project, disturbed: Disturbed) -> None:
    seed = random.randrange(2**32)
    print(f"seed {seed}, {KILLS} kills")
    choice = random.Random(seed)
    _, progress = disturbed("dashboard")
    for number in range(KILLS):
        victim = choice.choice(SERVICES)
        kill_main(project.containers(victim)[0])
        print(f"kill {number}: {victim}, {progress.episodes()} episodes")
        time.sleep(choice.uniform(0.0, 2.0))
