"""`bpn bench loop`: the loop's speed with real processes through the router, beside a bare echo.

One lockstep robot plays the reaching task; between its rounds, with the robot idle, the same bytes go
there and back with nothing else in the way.
"""

import json
import statistics
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bpn.bench.machine import machine
from bpn.local_run import free_endpoint, new_run
from bpn.summary import percentiles, summarize
from bpn.supervisor import Service, Supervisor, services_of_run
from bpn_shared.bus.echo import round_trips_us
from bpn_shared.bus.session import Bus
from bpn_shared.config import RunConfig
from bpn_shared.messages.action import Action
from bpn_shared.messages.frame import FrameHeader, FrameKind

ROUNDS, EPISODES, ECHOES = 5, 40, 1000
TARGETS = {"camera_to_action_p50_us": 350.0, "ratio_to_echo": 2.0, "steps_per_s": 700.0}


def run(rounds: int = ROUNDS) -> dict[str, Any]:
    """Measures loop and echo in turn.

    Returns:
        camera_to_action_us and echo_us ({p50, p99}; the medians of the rounds), ratio of the p50s,
        steps_per_s, inference_us, machine.
    """
    with tempfile.TemporaryDirectory(prefix="bpn-bench-") as directory:
        measured = [_round(Path(directory), index) for index in range(rounds)]

    def median(*path: str) -> float:
        return statistics.median(_dig(result, path) for result in measured)

    loop_p50, echo_p50 = median("loop", "camera_to_action_us", "p50"), median("echo_us", "p50")
    return {
        "rounds": rounds,
        "steps": sum(result["transitions"] for result in measured),
        "camera_to_action_us": {
            "p50": loop_p50,
            "p99": median("loop", "camera_to_action_us", "p99"),
        },
        "echo_us": {"p50": echo_p50, "p99": median("echo_us", "p99")},
        "ratio_to_echo": round(
            statistics.median(
                result["loop"]["camera_to_action_us"]["p50"] / result["echo_us"]["p50"]
                for result in measured
            ),
            3,
        ),
        "steps_per_s": median("loop", "steps_per_s"),
        "inference_us": {"p50": median("edge", "inference_us", "p50")},
        "targets": TARGETS,
        "machine": machine(),
    }


def _round(directory: Path, seed: int) -> dict[str, Any]:
    config = RunConfig.for_task(
        "reaching", seed=seed, iterations=3, episodes=EPISODES, epochs=1, datasets=1
    )
    folder = new_run(directory, config)
    endpoint = free_endpoint()
    services = services_of_run(folder.run, config, directory, endpoint)
    frame_bytes, action_bytes = _message_bytes(config)
    echo = ["bpn_shared.bus.echo", "--connect", endpoint, "--answer-bytes", str(action_bytes)]
    supervisor = Supervisor([*services, Service("echo", echo)], folder.logs)
    stop = threading.Event()
    try:
        supervisor.start()
        supervisor.wait("learner", stop)
        if supervisor.failure:
            raise RuntimeError(f"{supervisor.failure} in {folder.logs}")
        with Bus(endpoint) as bus:
            round_trips_us(bus, frame_bytes, ECHOES // 10)  # warm-up
            echoes = round_trips_us(bus, frame_bytes, ECHOES)
    finally:
        supervisor.stop()
    import numpy as np  # noqa: PLC0415

    return {**summarize(folder), "echo_us": percentiles(np.array(echoes))}


def _message_bytes(config: RunConfig) -> tuple[int, int]:
    header = FrameHeader(FrameKind.MID, 0, 0, 0, 0, 0).encode()
    channels, height, width = config.task_spec.frame_shape
    action = Action(0, 0, 0, 0, 0, 0).encode()
    return len(header) + channels * height * width, len(action)


def _dig(result: dict[str, Any], path: tuple[str, ...]) -> float:
    for key in path:
        result = result[key]
    return float(result)  # type: ignore[arg-type]


def main(*, as_json: bool) -> int:
    """Prints the measurement; exit status 1 if a target is missed."""
    result = run()
    if as_json:
        json.dump(result, sys.stdout)
        print()
    else:
        _print(result)
    met = (
        result["camera_to_action_us"]["p50"] <= TARGETS["camera_to_action_p50_us"]
        and result["ratio_to_echo"] <= TARGETS["ratio_to_echo"]
        and result["steps_per_s"] >= TARGETS["steps_per_s"]
    )
    return 0 if met else 1


def _print(result: dict[str, Any]) -> None:
    table = Table(
        "what", "p50", "p99", title=f"{result['steps']} steps in {result['rounds']} rounds"
    )
    for name in ("camera_to_action_us", "echo_us"):
        table.add_row(name, *(f"{result[name][key]:.0f}" for key in ("p50", "p99")))
    table.add_row("ratio_to_echo", f"{result['ratio_to_echo']:.2f}", "")
    table.add_row("inference_us", f"{result['inference_us']['p50']:.1f}", "")
    table.add_row("steps_per_s", f"{result['steps_per_s']:.0f}", "")
    Console().print(table)
