"""`bpn bench loop`: the loop's speed with real processes through the router, beside bare echoes.

One robot plays the reaching task. After each round, through the same router, with the same bytes and at the same
pace, the yardsticks: a plain TCP socket (what the machine gives), Zenoh request and reply, two Zenoh streams,
and the same with the robot's simulation and rendering before each ping (a core that has worked on something
else, or slept, answers more slowly).

Two paces. `hot`: in lockstep, frame after frame, nothing ever sleeps. `own`: the robot's own, a frame in each
control period and sleep between them, as it works.
"""

import itertools
import statistics
import tempfile
import threading
import time
from dataclasses import dataclass
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
from bpn_robot_sim.robots import make_robot
from bpn_shared.bus.echo import request_times_us, round_trips_us
from bpn_shared.bus.session import Bus
from bpn_shared.errors import InputError
from bpn_shared.messages.action import Action
from bpn_shared.messages.frame import FrameHeader, FrameKind
from bpn_shared.spec.config import RunConfig
from bpn_tasks.specs import CONTROL_PERIOD_S

TASK = "reaching"
YARDSTICKS = ("tcp_us", "request_us", "echo_us", "echo_after_render_us")
TARGETS = {"camera_to_action_p50_us": 350.0, "ratio_to_request": 2.0, "steps_per_s": 700.0}
"""At the hot pace."""


@dataclass(frozen=True)
class Pace:
    """How fast frames follow each other, and how many are measured.

    Attributes:
        pacing: of the run.
        period_s: from ping to ping; 0: one after the other.
        rounds, iterations, episodes: of the run, 20 steps an episode.
        echoes: of each yardstick in a round.
    """

    pacing: str
    period_s: float
    rounds: int
    iterations: int
    episodes: int
    echoes: int


PACES = {
    "hot": Pace("lockstep", 0.0, rounds=5, iterations=3, episodes=40, echoes=500),
    "own": Pace("realtime", CONTROL_PERIOD_S, rounds=3, iterations=1, episodes=10, echoes=100),
}  # fmt: skip
"""`own` takes about five minutes, nearly all of it asleep."""


def run(*, pace: str = "hot") -> dict[str, Any]:
    """Measures loop and yardsticks in turn.

    Returns:
        pace, period_ms, camera_to_action_us and every yardstick ({p50, p99}), the ratios of camera_to_action's
        p50 to theirs, steps_per_s, inference_us: medians of the rounds; targets (hot), machine.

    Raises:
        InputError: there is no such pace.
    """
    if pace not in PACES:
        raise InputError(f"--pace {pace}: there are {', '.join(PACES)}")
    chosen, measured_on = PACES[pace], machine()  # its load before the measurement adds its own
    with tempfile.TemporaryDirectory(prefix="bpn-bench-") as directory:
        measured = [_round(Path(directory), index, chosen) for index in range(chosen.rounds)]

    def medians(name: str) -> dict[str, float]:
        return {
            key: round(statistics.median(result[name][key] for result in measured), 1)
            for key in ("p50", "p99")
        }

    def ratio(name: str) -> float:
        ratios = [r["camera_to_action_us"]["p50"] / r[name]["p50"] for r in measured]
        return round(float(statistics.median(ratios)), 2)

    return {
        "pace": pace,
        "period_ms": round(1e3 * chosen.period_s),
        "rounds": chosen.rounds,
        "steps": sum(result["steps"] for result in measured),
        "camera_to_action_us": medians("camera_to_action_us"),
        **{name: medians(name) for name in YARDSTICKS},
        "ratio_to": {name: ratio(name) for name in YARDSTICKS},
        "steps_per_s": statistics.median(result["steps_per_s"] for result in measured),
        "inference_us": medians("inference_us"),
        "targets": TARGETS if pace == "hot" else {},
        "machine": measured_on,
    }


def _round(directory: Path, seed: int, pace: Pace) -> dict[str, Any]:
    config = RunConfig.for_task(
        TASK, seed=seed, hidden_units=100, iterations=pace.iterations, episodes=pace.episodes,
        epochs=1, replay_iterations=1, pacing=pace.pacing,
    )  # fmt: skip
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
        yardsticks = _yardsticks(endpoint, frame_bytes, action_bytes, pace)
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


def _yardsticks(
    endpoint: str, frame_bytes: int, action_bytes: int, pace: Pace
) -> dict[str, list[float]]:
    robot = make_robot(TASK)
    robot.reset(0)
    actions = itertools.cycle(range(robot.task.actions))
    wait = _Ticks(pace.period_s).wait

    def render() -> None:
        wait()
        robot.command(next(actions))
        robot.settle()
        robot.frame()

    with Bus(endpoint) as bus:
        round_trips_us(bus, frame_bytes, 50)  # warm-up
        times = {
            "tcp_us": tcp_round_trips_us(frame_bytes, action_bytes, pace.echoes, between=wait),
            "request_us": request_times_us(bus, frame_bytes, pace.echoes, between=wait),
            "echo_us": round_trips_us(bus, frame_bytes, pace.echoes, between=wait),
            "echo_after_render_us": round_trips_us(bus, frame_bytes, pace.echoes, between=render),
        }
    robot.close()
    return times


class _Ticks:
    """Equal periods, as the robot's driver has them."""

    def __init__(self, period_s: float) -> None:
        self._period_s, self._next_s = period_s, 0.0

    def wait(self) -> None:
        """Sleeps until the next period begins."""
        now_s = time.monotonic()
        self._next_s = max(self._next_s + self._period_s, now_s)
        time.sleep(self._next_s - now_s)


def _message_bytes(config: RunConfig) -> tuple[int, int]:
    header = FrameHeader(FrameKind.MID, 0, 0, 0, 0, 0).encode()
    channels, height, width = config.task_spec.frame_shape
    action = Action(0, 0, 0, 0, 0, 0).encode()
    return len(header) + channels * height * width, len(action)


def met(result: dict[str, Any]) -> bool:
    """Whether the measurement reaches its targets, which the hot pace alone has."""
    return not result["targets"] or bool(
        result["camera_to_action_us"]["p50"] <= TARGETS["camera_to_action_p50_us"]
        and result["ratio_to"]["request_us"] <= TARGETS["ratio_to_request"]
        and result["steps_per_s"] >= TARGETS["steps_per_s"]
    )


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    pace = f"one in {result['period_ms']} ms" if result["period_ms"] else "one after the other"
    title = f"{result['steps']} steps in {result['rounds']} rounds, {pace}, {result['steps_per_s']:.0f} steps/s"
    host = result["machine"]
    caption = f"{host['cpu']}, {host['cores']} cores, load {host['load_average'][0]}"
    table = Table("what", "p50 us", "p99 us", "camera to action is", title=title, caption=caption)
    for name in ("camera_to_action_us", "inference_us", *YARDSTICKS):
        times = " ".join(f"{result[name][key]:8.1f}" for key in ("p50", "p99")).split()
        ratio = result["ratio_to"].get(name)
        table.add_row(name.removesuffix("_us"), *times, f"{ratio:.2f} x" if ratio else "")
    Console().print(table)
