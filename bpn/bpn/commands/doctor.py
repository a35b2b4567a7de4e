"""`bpn doctor`: what this machine has, for bug reports."""

import argparse
import json
import platform
import socket
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import psutil
from rich.console import Console
from rich.markup import escape

from bpn.bench.machine import versions
from bpn_shared.bus.session import DEFAULT_ENDPOINT

_RENDERING_S = 60.0


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
            console.print(
                f"[bold]{name}[/bold]: ",
                escape(_readable(value)),
                sep="",
                highlight=False,
                soft_wrap=True,
            )
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
        "kernel_paths": _kernel_paths(),
        "rendering": _rendering(),
        "default_router_port": _port_state(),
    }


def _kernel_paths() -> list[str]:
    try:
        from bpn_edge.kernel import native  # noqa: PLC0415 - what fails here is what we report

        return list(native.available_paths())
    except Exception as error:
        return [_told(error)]


def _rendering() -> dict[str, Any]:
    # In a process of its own: an OpenGL driver may end it, and we have to say so.
    look = "from bpn_robot_sim.robots import make_robot; from bpn_robot_sim import rendering; "
    look += "make_robot('reaching').close(); print(rendering.backend())"
    try:
        done = subprocess.run(  # noqa: S603 - our own modules
            [sys.executable, "-c", look],
            capture_output=True, text=True, errors="replace", timeout=_RENDERING_S, check=False,
        )  # fmt: skip
    except (subprocess.TimeoutExpired, OSError) as error:
        return {"works": False, "error": _told(error)}
    if done.returncode == 0:
        return {"works": True, "backend": done.stdout.strip().splitlines()[-1]}
    last = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
    return {"works": False, "error": last[0]}


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


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
