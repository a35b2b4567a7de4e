"""How much faster a second learner finishes a sweep, in containers, and what the processors do meanwhile.

The same sweep is done by one learner and by two, in turns, with everything else equal; both must come to the same
weights. Needs a Docker Engine; writes docs/results/sweep.json. About a quarter of an hour on two cores:

    make bench-sweep
"""

import json
import os
import re
import socket
import statistics
import time
import uuid
from pathlib import Path
from typing import Any

from chaos import facts
from compose_project import SERVICES, Project, build_images, docker
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from bpn.bench.machine import machine

RESULT = Path(__file__).resolve().parents[1] / "docs" / "results" / "sweep.json"
SWEEP: dict[str, Any] = {
    "name": "learners",
    "config": {"task": "tracking", "iterations": 15},
    "grid": {},
    "seeds": [0, 1],
}
TURNS = (1, 2, 2, 1)
ROBOTS = 2
TIMEOUT_S = 1800.0
SETTLE_S = 5.0
"""Until workers that were started have asked for work."""
POLL_S = 0.5
_NS = 1e9
_CPU_TIME = "cat /sys/fs/cgroup/cpu.stat /sys/fs/cgroup/cpuacct/cpuacct.usage 2>/dev/null || true"


def main() -> None:
    """Measures, prints a table, writes the result."""
    console = Console()
    measured_on = machine()  # its load before the measurement adds its own
    build_images()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port: int = listening.getsockname()[1]
    os.environ |= {"BPN_PORT": str(port), "BPN_FIRST_RUN": ""}
    project = Project(f"bpn-bench-{uuid.uuid4().hex[:8]}", port)
    turns = []
    try:
        for learners in TURNS:
            turns.append(turn(project, learners))
            console.print(f"{learners} learners: {turns[-1]['seconds']:.1f} s")
    finally:
        project.down()
    if len({json.dumps(turn["weights_sha256"]) for turn in turns}) != 1:
        raise SystemExit("one learner and two came to different weights")
    result = {"sweep": SWEEP, "turns": turns, "speedup": speedup(turns), "machine": measured_on}
    console.print(table(turns))
    console.print(f"two learners are {result['speedup']:.2f} times as fast")
    RESULT.write_text(json.dumps(result, indent=1) + "\n")


def turn(project: Project, learners: int) -> dict[str, Any]:
    """The sweep from its start until its last run is finished."""
    counts = {"learner": learners, "edge": ROBOTS, "robot_sim": ROBOTS}
    project.up(*(part for name, n in counts.items() for part in ("--scale", f"{name}={n}")))
    time.sleep(SETTLE_S)
    token = project.token()  # once: asking for it takes more processor time than the dashboard does
    before, started_s = cpu_times_s(project), time.monotonic()
    sweep = project.api("POST", "/sweeps", SWEEP, token)
    runs = sweep["run_ids"]
    while sweep["states"] != {"finished": len(runs)}:
        if "failed" in sweep["states"] or time.monotonic() - started_s > TIMEOUT_S:
            raise SystemExit(
                f"the sweep is not finished after {TIMEOUT_S:.0f} s, or failed: {sweep}"
            )
        time.sleep(POLL_S)
        sweep = project.api("GET", f"/sweeps/{sweep['id']}", token=token)
    seconds, after = time.monotonic() - started_s, cpu_times_s(project)
    lines = [
        json.loads(line)
        for run in runs
        for line in project.compose(
            "exec", "-T", "dashboard", "cat", f"/runs/{run}/metrics.jsonl"
        ).splitlines()
    ]
    return {
        "learners": learners,
        "seconds": seconds,
        "cpu_s": {service: after[service] - before[service] for service in SERVICES},
        "collect_s": sum(line["collect_s"] for line in lines),
        "update_s": sum(line["update_s"] for line in lines),
        "weights_sha256": [facts(project, run)["weights"] for run in runs],
    }


def cpu_times_s(project: Project) -> dict[str, float]:
    """Processor time that each service's containers have used."""
    times = {}
    for service in SERVICES:
        said = [docker("exec", c, "sh", "-c", _CPU_TIME) for c in project.containers(service)]
        times[service] = sum(map(_cpu_time_s, said))
    return times


def _cpu_time_s(said: str) -> float:
    """Of cgroup v2's cpu.stat, or of v1's nanoseconds."""
    if usage := re.search(r"^usage_usec (\d+)", said):
        return int(usage[1]) / 1e6
    return int(said.rsplit(maxsplit=1)[-1]) / _NS


def speedup(turns: list[dict[str, Any]]) -> float:
    """Ratio of the medians."""
    seconds: dict[int, list[float]] = {1: [], 2: []}
    for turn in turns:
        seconds[turn["learners"]].append(turn["seconds"])
    return statistics.median(seconds[1]) / statistics.median(seconds[2])


def table(turns: list[dict[str, Any]]) -> Table:
    """Where the time went: the sweep's, what its runs' add up to, and each service's processor time."""
    shown = Table(
        "learners", "sweep", "collect", "update", *SERVICES, title="seconds", box=SIMPLE, padding=0
    )
    for turn in turns:
        cells = [turn["seconds"], turn["collect_s"], turn["update_s"], *turn["cpu_s"].values()]
        shown.add_row(str(turn["learners"]), *(f"{cell:.1f}" for cell in cells))
    return shown


if __name__ == "__main__":
    main()
