"""The liveness probes of the manifests, asked of containers whose router is away for two minutes."""

import time
from collections.abc import Callable

from chaos import LONG, RUN_TIMEOUT_S, Progress, facts
from compose_project import Project, docker
from probes import Probe, probe_of

from bpn_shared.bus.access import ROLES

WaitFor = Callable[..., None]
AWAY_S = 120.0
STUCK_S = 90.0
"""A service that stands still has failed its probes by then."""


def probes(project: Project, kind: str) -> dict[str, Probe]:
    """Of every service but the router."""
    found = {}
    for service in ROLES:
        (container,) = project.containers(service)
        found[service] = Probe(container, probe_of(service, kind), project.port)
    return found


def test_nobody_is_killed_while_the_router_is_away_for_two_minutes(project: Project) -> None:
    undisturbed = project.start_run(**LONG)
    project.wait_finished(undisturbed, RUN_TIMEOUT_S)
    run = project.start_run(**LONG)
    Progress(project, run, "router").wait_beyond(50, RUN_TIMEOUT_S)
    alive, ready = probes(project, "livenessProbe"), probes(project, "readinessProbe")
    started = {s: project.state(probe.container)["StartedAt"] for s, probe in alive.items()}

    project.compose("stop", "router")
    away_until_s = time.monotonic() + AWAY_S
    while time.monotonic() < away_until_s:
        for probe in (*alive.values(), *ready.values()):
            probe.look()
        time.sleep(0.1)
    project.compose("start", "router")

    print({service: f"{p.failures} of {p.asked} failed" for service, p in alive.items()})
    assert all(probe.asked >= AWAY_S / 2 / probe.what["periodSeconds"] for probe in alive.values())
    assert not any(probe.would_act for probe in alive.values())
    workers = set(ROLES) - {"dashboard"}  # whose pages say what is wrong
    assert {service for service, probe in ready.items() if probe.would_act} == workers
    project.wait_finished(run, RUN_TIMEOUT_S)
    project.wait_well()
    assert started == {s: project.state(p.container)["StartedAt"] for s, p in alive.items()}
    assert facts(project, run) == facts(project, undisturbed)


def test_who_stands_still_is_killed(project: Project, wait_for: WaitFor) -> None:
    (container,) = project.containers("edge")
    probe = Probe(container, probe_of("edge", "livenessProbe"))
    signal_main = "kill -{} $(cat /proc/1/task/1/children)"
    docker("exec", container, "bash", "-c", signal_main.format("STOP"))

    def would_be_killed() -> bool:
        probe.look()
        return probe.would_act

    try:
        wait_for(would_be_killed, "the probe to fail", STUCK_S)
    finally:
        docker("exec", container, "bash", "-c", signal_main.format("CONT"))
    project.wait_well()
