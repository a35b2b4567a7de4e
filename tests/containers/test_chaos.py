"""What may happen to containers during a run without changing its result: every fault, and then the same weights.

`make test-chaos` runs these. Each fault hits a run in its middle; how long it takes until the next episode is
stored is printed, which is where ARCHITECTURE.md has its seconds from.
"""

import contextlib
import functools
import os
import random
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator

import pytest
from chaos import LONG, RUN_TIMEOUT_S, Progress, facts, kill_main, report_pause, reported_return
from compose_project import SERVICES, EngineError, Project, docker

pytestmark = pytest.mark.skipif("BPN_CHAOS" not in os.environ, reason="run `make test-chaos`")

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
        project.wait_well()
        found = facts(project, run)
        assert (found["lost"], found["duplicated"]) == (0, 0)
        assert found == undisturbed(**config)


Disturbed = Callable[..., tuple[str, Progress]]


@pytest.mark.parametrize("service", SERVICES)
def test_kill_9(project: Project, disturbed: Disturbed, service: str) -> None:
    _, progress = disturbed(service)
    (container,) = project.containers(service)
    killed_unix_s = time.time()
    kill_main(container)
    report_pause(f"kill -9 {service}", progress, killed_unix_s)


def test_the_router_is_restarted(project: Project, disturbed: Disturbed) -> None:
    _, progress = disturbed("router")
    restarted_unix_s = time.time()
    project.compose("restart", "router")
    report_pause("router restarted", progress, restarted_unix_s)


@pytest.mark.parametrize("service", ["router", "edge", "learner"])
def test_frozen_for_8_s(project: Project, disturbed: Disturbed, service: str) -> None:
    _, progress = disturbed(service)
    (container,) = project.containers(service)
    docker("pause", container)
    time.sleep(8)  # the fault itself
    with reported_return(f"{service} frozen for 8 s", progress):
        docker("unpause", container)


@pytest.mark.parametrize("service", ["edge", "learner"])
def test_without_network_for_15_s(project: Project, disturbed: Disturbed, service: str) -> None:
    _, progress = disturbed(service)
    (container,) = project.containers(service)
    network = f"{project.name}_bus"
    docker("network", "disconnect", network, container)
    time.sleep(15)  # the fault itself
    with reported_return(f"{service} without network for 15 s", progress):
        docker("network", "connect", "--alias", service, network, container)


@pytest.mark.skipif(
    os.geteuid() != 0 or not shutil.which("nsenter") or not shutil.which("iptables"),
    reason="dropping packets needs root, nsenter and iptables beside the engine",
)
def test_30_percent_of_packets_lost(project: Project, disturbed: Disturbed) -> None:
    _, progress = disturbed("edge")
    (container,) = project.containers("edge")
    inside = ["nsenter", "-t", str(project.state(container)["Pid"]), "-n", "iptables"]
    rule = ["INPUT", "-m", "statistic", "--mode", "random", "--probability", "0.3", "-j", "DROP"]
    before = len(progress.stored_unix_s())
    subprocess.run([*inside, "-A", *rule], check=True, timeout=10)
    time.sleep(10)  # the fault itself
    print(f"PACKET LOSS: {len(progress.stored_unix_s()) - before} episodes in 10 s")
    with reported_return("30 % packet loss for 10 s", progress):
        subprocess.run([*inside, "-D", *rule], check=True, timeout=10)


def test_a_storm_of_sigterm(project: Project, disturbed: Disturbed) -> None:
    _, progress = disturbed("edge")
    workers = [c for s in ("edge", "robot_sim", "learner") for c in project.containers(s)]
    started = [project.state(container)["StartedAt"] for container in workers]
    began_unix_s = time.time()
    for _ in range(3):
        for container in workers:
            # One that is on its way down, or not back from the last round, fails or ends the command.
            with contextlib.suppress(EngineError):
                docker("exec", container, "bash", "-c", "kill $(cat /proc/1/task/1/children)")
    report_pause("three rounds of SIGTERM to all workers", progress, began_unix_s)
    for container, before in zip(workers, started, strict=True):
        assert project.state(container)["StartedAt"] != before


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
    project.wait_well()
    print(
        f"killed {dict(killed)}, then {project.api('GET', f'/runs/{run}')['iteration']} iterations done"
    )


def test_a_learner_that_is_cut_off_is_replaced_by_an_idle_one(
    project: Project, disturbed: Disturbed
) -> None:
    project.up("--scale", "learner=2")
    try:
        run, progress = disturbed("edge")
        (holder,) = (c for c in project.containers("learner") if holds(c, run))
        network = f"{project.name}_bus"
        docker("network", "disconnect", network, holder)
        began_unix_s, before = time.time(), len(progress.stored_unix_s())
        first_unix_s = progress.wait_beyond(before, timeout_s=120.0)[before]
        print(f"REPLACED learner cut off: {first_unix_s - began_unix_s:.1f} s after")
        docker("network", "connect", "--alias", "learner", network, holder)
        project.wait_finished(run, RUN_TIMEOUT_S)
    finally:
        project.up("--scale", "learner=1")


def holds(container: str, run: str) -> bool:
    """Whether a learner has the lock of a run."""
    with contextlib.suppress(EngineError):
        docker("exec", container, "sh", "-c", f"ls -l /proc/[0-9]*/fd | grep -q {run}/.lock")
        return True
    return False
