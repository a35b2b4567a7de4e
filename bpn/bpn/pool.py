"""The dashboard with a pool of workers on this machine: what `bpn up` runs."""

import os
import platform
from dataclasses import dataclass
from pathlib import Path

from bpn.certified import environment, local_endpoint
from bpn.supervisor import Service
from bpn_shared.bus.access import ROUTER


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
) -> list[Service]:
    """Router, dashboard, and workers that take whatever the registry gives them.

    Robot k and edge k take turns, so they share a core and say so by their place; the first pair shares
    it with the router.

    Args:
        endpoint: where the router listens.
        dashboard: more options of the dashboard.
        certificates: a folder for each role (`bpn-certificates`), for a router that others reach over TLS.
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
    for role, name, count in (
        ("robot_sim", "robot", size.robots),
        ("edge", "edge", size.edges),
    ):
        for index in range(count):
            place = ["--place", f"{platform.node()}/{index}"]
            services.append(
                Service(
                    f"{name}-{index}",
                    [f"bpn_{role}", *connect, *place],
                    core=cores[index % len(cores)],
                    essential=False,
                    environment=environment(certificates, role),
                )
            )
    return services
