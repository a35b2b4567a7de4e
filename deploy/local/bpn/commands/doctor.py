"""`bpn doctor`: what this machine has, for bug reports."""

import argparse
import json
import platform
import socket
from typing import Any

import psutil
from rich.console import Console

from bpn.bench.machine import versions
from bpn_edge.kernel import native
from bpn_shared.bus.session import DEFAULT_ENDPOINT


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Prints the report; exit status 1 if something needed is missing."""
    report = examine()
    if options.json:
        print(json.dumps(report))
    else:
        console = Console()
        for name, value in report.items():
            console.print(f"[bold]{name}[/bold]: {_readable(value)}", highlight=False)
    return 0 if report["rendering"]["works"] else 1


def examine() -> dict[str, Any]:
    """Machine, versions, instruction sets, rendering back end, ports."""
    return {
        "machine": {
            "system": platform.platform(),
            "python": platform.python_version(),
            "cores": psutil.cpu_count(logical=True),
            "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
            "load_average": [round(load, 2) for load in psutil.getloadavg()],
        },
        "versions": versions(),
        "kernel_paths": list(native.available_paths()),
        "rendering": _rendering(),
        "default_router_port": _port_state(),
    }


def _rendering() -> dict[str, Any]:
    from bpn_robot_sim import rendering  # noqa: PLC0415 - what fails here is what we report
    from bpn_robot_sim.robot import make_robot  # noqa: PLC0415

    try:
        make_robot("reaching").close()
        return {"works": True, "backend": rendering.backend()}
    except (ImportError, RuntimeError, OSError) as error:
        return {"works": False, "error": str(error)}


def _port_state() -> str:
    host, port = DEFAULT_ENDPOINT.removeprefix("tcp/").rsplit(":", 1)
    with socket.socket() as probe:
        probe.settimeout(0.5)
        in_use = probe.connect_ex((host, int(port))) == 0
    return f"{DEFAULT_ENDPOINT}: {'in use' if in_use else 'free'}"


def _readable(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {item}" for key, item in value.items())
    return ", ".join(value) if isinstance(value, list) else str(value)
