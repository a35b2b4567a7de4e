"""`bpn bench loop`: the loop's speed with real processes through the router, beside bare echoes.

One lockstep robot plays the reaching task. After each round, through the same router and with the same
bytes, the yardsticks: a plain TCP socket (what the machine gives), Zenoh request and reply, two Zenoh streams
back to back, and the same at the loop's pace, with the robot's simulation and rendering between two pings
(a core that has worked on something else, or slept, answers more slowly).
"""

import itertools
import statistics
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bpn.bench.machine import machine
from bpn.bench.tcp import tcp_round_trips_us
from bpn.local_run import new_run, private_endpoint
from bpn.summary import percentiles, summarize
from bpn.supervisor import Service, Supervisor, services_of_run
from bpn_robot_sim.robot import make_robot
from bpn_shared.bus.echo import request_times_us, round_trips_us
from bpn_shared.bus.session import Bus
from bpn_shared.config import RunConfig
from bpn_shared.messages.action import Action
from bpn_shared.messages.frame import FrameHeader, FrameKind

ROUNDS, EPISODES, ECHOES = 5, 40, 500
YARDSTICKS = ("tcp_us", "request_us", "echo_us", "paced_echo_us")
TARGETS = {"camera_to_action_p50_us": 350.0, "ratio_to_request": 2.0, "steps_per_s": 700.0}


def run(rounds: int = ROUNDS) -> dict[str, Any]:
    """Measures loop and yardsticks in turn.

    Returns:
        camera_to_action_us and every yardstick ({p50, p99}), the ratios of camera_to_action's p50 to
        theirs, steps_per_s, inference_us: medians of the rounds; targets, machine.
    """
    with tempfile.TemporaryDirectory(prefix="bpn-bench-") as directory:
        measured = [_round(Path(directory), index) for index in range(rounds)]

    def medians(name: str) -> dict[str, float]:
        return {
            key: round(statistics.median(result[name][key] for result in measured), 1)
            for key in ("p50", "p99")
        }

    def ratio(name: str) -> float:
        ratios = [r["camera_to_action_us"]["p50"] / r[name]["p50"] for r in measured]
        return round(float(statistics.median(ratios)), 2)

    return {
        "rounds": rounds,
        "steps": sum(result["steps"] for result in measured),
        "camera_to_action_us": medians("camera_to_action_us"),
        **{name: medians(name) for name in YARDSTICKS},
        "ratio_to": {name: ratio(name) for name in YARDSTICKS},
        "steps_per_s": statistics.median(result["steps_per_s"] for result in measured),
        "inference_us": medians("inference_us"),
        "targets": TARGETS,
        "machine": machine(),
    }


def _round(directory: Path, seed: int) -> dict[str, Any]:
    config = RunConfig.for_task(
        "reaching", seed=seed, nodes=100, iterations=3, episodes=EPISODES, epochs=1, datasets=1
    )
    folder = new_run(directory, config)
    endpoint = private_endpoint()
    services = services_of_run(folder.run, config, directory, endpoint)
    frame_bytes, action_bytes = _message_bytes(config)
    echo = ["bpn_shared.bus.echo", "--connect", endpoint, "--answer-bytes", str(action_bytes)]
    supervisor = Supervisor([*services, Service("echo", echo)], folder.logs)
    stop = threading.Event()
    try:
        supervisor.start()
        supervisor.wait("learner", stop)
        if supervisor.failure:
            raise RuntimeError(supervisor.failure)
        yardsticks = _yardsticks(endpoint, frame_bytes, action_bytes)
    finally:
        supervisor.stop()
    summary = summarize(folder)
    return {
        "steps": summary["transitions"],
        "camera_to_action_us": summary["loop"]["camera_to_action_us"],
        "inference_us": summary["edge"]["inference_us"],
        "steps_per_s": summary["loop"]["steps_per_s"],
        **{name: percentiles(np.array(times)) for name, times in yardsticks.items()},
    }


def _yardsticks(endpoint: str, frame_bytes: int, action_bytes: int) -> dict[str, list[float]]:
    robot = make_robot("reaching")
    robot.reset(0)
    actions = itertools.cycle(range(robot.task.actions))

    def step_robot() -> None:
        robot.command(next(actions))
        robot.settle()
        robot.frame()

    with Bus(endpoint) as bus:
        round_trips_us(bus, frame_bytes, ECHOES // 10)  # warm-up
        times = {
            "tcp_us": tcp_round_trips_us(frame_bytes, action_bytes, ECHOES),
            "request_us": request_times_us(bus, frame_bytes, ECHOES),
            "echo_us": round_trips_us(bus, frame_bytes, ECHOES),
            "paced_echo_us": round_trips_us(bus, frame_bytes, ECHOES, between=step_robot),
        }
    robot.close()
    return times


def _message_bytes(config: RunConfig) -> tuple[int, int]:
    header = FrameHeader(FrameKind.MID, 0, 0, 0, 0, 0).encode()
    channels, height, width = config.task_spec.frame_shape
    action = Action(0, 0, 0, 0, 0, 0).encode()
    return len(header) + channels * height * width, len(action)


def met(result: dict[str, Any]) -> bool:
    """Whether the measurement reaches its targets."""
    return bool(
        result["camera_to_action_us"]["p50"] <= TARGETS["camera_to_action_p50_us"]
        and result["ratio_to"]["request_us"] <= TARGETS["ratio_to_request"]
        and result["steps_per_s"] >= TARGETS["steps_per_s"]
    )


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    title = (
        f"{result['steps']} steps in {result['rounds']} rounds, {result['steps_per_s']:.0f} steps/s"
    )
    table = Table("what", "p50 us", "p99 us", "camera to action is", title=title)
    for name in ("camera_to_action_us", "inference_us", *YARDSTICKS):
        times = " ".join(f"{result[name][key]:8.1f}" for key in ("p50", "p99")).split()
        ratio = result["ratio_to"].get(name)
        table.add_row(name.removesuffix("_us"), *times, f"{ratio:.2f} x" if ratio else "")
    Console().print(table)
