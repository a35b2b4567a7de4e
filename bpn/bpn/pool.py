"""The dashboard with a pool of workers on this machine: what `bpn up` runs."""

import os
import platform
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from bpn.certified import environment, local_endpoint
from bpn.supervisor import Service
from bpn_shared.bus.access import ROUTER
from bpn_shared.bus.endpoint import network
from bpn_shared.runtime.gym_modules import as_arguments


@dataclass(frozen=True)
class PoolSize:
    """How many workers of each kind."""

    robots: int
    edges: int
    learners: int


def services_of_pool(
    size: PoolSize,
    runs_dir: Path,
    endpoint: str,
    dashboard: list[str],
    *,
    certificates: Path | None = None,
    enrolment_port: int | None = None,
    gym_modules: Collection[str] = (),
) -> list[Service]:
    """Router, dashboard, and workers that take whatever the registry gives them.

    Robot k and edge k take turns, so they share a core and say so by their place; the first pair shares
    it with the router.

    Args:
        endpoint: where the router listens.
        dashboard: more options of the dashboard.
        certificates: a folder for each role (`bpn-certificates`), for a router that others reach over TLS.
        enrolment_port: where machines that have a token are admitted; None: they are not.
        gym_modules: what robots may import for `gym:` tasks.
    """
    cores = sorted(os.sched_getaffinity(0))
    connect = ["--connect", local_endpoint(endpoint)]
    secured = [] if certificates is None else ["--certificates", str(certificates / ROUTER)]
    runs = ["--runs-dir", str(runs_dir)]
    services = [
        Service("router", ["bpn_shared.bus.router", "--listen", endpoint, *secured], core=cores[0]),
        Service(
            "dashboard",
            ["bpn_dashboard", *connect, *runs, *dashboard],
            speaks=True,
            environment=environment(certificates, "dashboard"),
        ),
    ]
    for index in range(size.learners):
        arguments = ["bpn_learner", *connect, *runs]
        services.append(
            Service(
                f"learner-{index}",
                arguments,
                essential=False,
                environment=environment(certificates, "learner"),
            )
        )
    if certificates is not None and enrolment_port is not None:
        services.append(enrolment(certificates, endpoint, enrolment_port))
    return services + robots_and_edges(
        size,
        local_endpoint(endpoint),
        lambda role: environment(certificates, role),
        gym_modules=gym_modules,
    )


def robots_and_edges(
    size: PoolSize,
    endpoint: str,
    environment_of: Callable[[str], Mapping[str, str]],
    *,
    gym_modules: Collection[str] = (),
) -> list[Service]:
    """Those of one machine: robot k and edge k share a core, the first pair with the router.

    Args:
        environment_of: by role, environment variables that lead to certificates.
    """
    cores = sorted(os.sched_getaffinity(0))
    services = []
    for role, name, count, more in (
        ("robot_sim", "robot", size.robots, as_arguments(gym_modules)),
        ("edge", "edge", size.edges, []),
    ):
        for index in range(count):
            place = ["--connect", endpoint, "--place", f"{platform.node()}/{index}"]
            services.append(
                Service(
                    f"{name}-{index}",
                    [f"bpn_{role}", *place, *more],
                    core=cores[index % len(cores)],
                    essential=False,
                    environment=environment_of(role),
                )
            )
    return services


def enrolment(certificates: Path, endpoint: str, port: int) -> Service:
    """Admits machines to a router at an endpoint with a host and a port."""
    router = network(endpoint)
    assert router is not None  # it asks for certificates, so it is no socket file
    where = ["--host", router.host, "--port", str(port), "--router-port", str(router.port)]
    arguments = ["bpn_certificates.enrolment", str(certificates), *where]
    return Service("enrolment", arguments, essential=False)
