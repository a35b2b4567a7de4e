"""What a measurement was made on and with."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import psutil

_PACKAGES = (
    "bpn", "bpn-shared", "bpn-edge", "bpn-learner", "bpn-robot", "bpn-robot-sim", "bpn-tasks", "bpn-dashboard",
    "eclipse-zenoh", "numpy", "torch", "mujoco", "gymnasium", "onnxruntime", "opencv-python-headless", "pydantic",
    "msgpack", "safetensors",
)  # fmt: skip


def machine() -> dict[str, Any]:
    """CPU model, cores, load average, Python."""
    return {
        "cpu": _cpu_model(),
        "cores": psutil.cpu_count(logical=True),
        "load_average": [round(load, 2) for load in psutil.getloadavg()],
        "python": platform.python_version(),
        "system": platform.platform(),
    }


def versions() -> dict[str, str]:
    """The distributions that results may depend on, with their versions."""
    return {name: _version(name) for name in _PACKAGES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _cpu_model() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


@contextmanager
def one_core() -> Iterator[None]:
    """Keeps this process on one core, as every candidate of a side-by-side measurement is."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
