"""What may happen to containers during a run without changing its result: every fault, and then the same weights.

`make test-chaos` runs these. Each fault hits a run in its middle; how long it takes until the next episode is
stored is printed, which is where ARCHITECTURE.md has its seconds from.
"""

import functools
import os
import random
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator

import pytest
from chaos import LONG, RUN_TIMEOUT_S, Progress, facts, kill_main, report
from compose_project import EngineError, Project, docker

from bpn_shared.access import ROLES

pytestmark = pytest.mark.skipif("BPN_CHAOS" not in os.environ, reason="run `make test-chaos`")

SERVICES = ("router", *ROLES)
MANY = LONG | {"iterations": 60, "episodes": 10}
"""Short iterations: a learner that dies before it has done one is a crash loop, and given up for good reason."""
KILLS = int(os.environ.get("BPN_CHAOS_KILLS", "50"))


@pytest.fixture(scope="module")
def undisturbed(project: Project) -> Callable[..., dict[str, object]]:
    """What a run with a configuration comes to when nobody disturbs it."""

    @functools.cache
    def of(**config: int) -> dict[str, object]:
        run = project.start_run(**config)
        project.wait_finished(run, RUN_TIMEOUT_S)
        return facts(project, run)

    return of


@pytest.fixture
def disturbed(
    project: Project, undisturbed: Callable[..., dict[str, object]]
) -> Iterator[Callable[..., tuple[str, Progress]]]:
    """Starts a run and waits for its middle; at the end it must equal the undisturbed one."""
    started: list[tuple[str, dict[str, int]]] = []

    def start(victim: str, config: dict[str, int] = LONG) -> tuple[str, Progress]:
        undisturbed(**config)
        run = project.start_run(**config)
        started.append((run, config))
        progress = Progress(project, run, victim)
        progress.wait_beyond(50, RUN_TIMEOUT_S)
        return run, progress

    yield start
    for run, config in started:
        project.wait_finished(run, RUN_TIMEOUT_S)
        project.up()  # until everything is well again
        found = facts(project, run)
        assert (found["lost"], found["duplicated"]) == (0, 0)
        assert found == undisturbed(**config)


Disturbed = Callable[..., tuple[str, Progress]]


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
    run, _ = disturbed("dashboard", MANY)
    killed: Counter[str] = Counter()
    while killed.total() < KILLS:
        victim = choice.choice(SERVICES)
        try:
            kill_main(project.containers(victim)[0])
        except (EngineError, IndexError):
            continue  # it is not back from the last time
        killed[victim] += 1
        time.sleep(choice.uniform(0.0, 4.0))
    project.up()
    print(
        f"killed {dict(killed)}, then {project.api('GET', f'/runs/{run}')['iteration']} iterations done"
    )
