"""The dashboard with a pool of workers on this machine: what `bpn up` runs."""

import os
import platform
from dataclasses import dataclass
from pathlib import Path

from bpn.supervisor import Service


@dataclass(frozen=True)
class PoolSize:
    """How many workers of each kind."""

    robots: int
    edges: int
    learners: int


def services_of_pool(
    size: PoolSize, runs_dir: Path, endpoint: str, dashboard: list[str]
) -> list[Service]:
    """Router, dashboard, and workers that take whatever the registry gives them.

    Robot k and edge k take turns, so they share a core and say so by their place; the first pair shares
    it with the router.

    Args:
        dashboard: more options of the dashboard.
    """
    cores = sorted(os.sched_getaffinity(0))
    connect = ["--connect", endpoint]
    runs = ["--runs-dir", str(runs_dir)]
    services = [
        Service("router", ["bpn_shared.bus.router", "--listen", endpoint], core=cores[0]),
        Service("dashboard", ["bpn_dashboard", *connect, *runs, *dashboard], speaks=True),
    ]
    for index in range(size.learners):
        arguments = ["bpn_learner", *connect, *runs]
        services.append(Service(f"learner-{index}", arguments, essential=False))
    for module, name, count in (
        ("bpn_robot_sim", "robot", size.robots),
        ("bpn_edge", "edge", size.edges),
    ):
        for index in range(count):
            place = ["--place", f"{platform.node()}/{index}"]
            services.append(
                Service(
                    f"{name}-{index}",
                    [module, *connect, *place],
                    core=cores[index % len(cores)],
                    essential=False,
                )
            )
    return services
