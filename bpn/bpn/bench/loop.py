"""`bpn bench loop`: the loop's speed with real processes, past the router and through it, beside bare echoes.

One robot plays the reaching task, in each round once with robot and edge talking past the router, as they do on
one machine, and once through it; then the yardsticks (`bpn.bench.yardsticks`), with the same bytes, on the same
core and at the same pace.

Two paces. `hot`: in lockstep, frame after frame, nothing ever sleeps. `own`: the robot's own, a frame in each
control period and sleep between them, as it works.
"""

import statistics
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bpn.bench import yardsticks
from bpn.bench.machine import machine
from bpn.local_run import new_run, private_endpoint
from bpn.summary import percentiles, summarize
from bpn.supervisor import Service, Supervisor, services_of_run
from bpn_shared.errors import InputError
from bpn_shared.messages.action import Action
from bpn_shared.messages.frame import FrameHeader, FrameKind
from bpn_shared.spec.config import RunConfig
from bpn_tasks.specs import CONTROL_PERIOD_S

TASK = "reaching"
ROUTED = "routed_camera_to_action_us"
YARDSTICKS = yardsticks.NAMES
TARGETS = {
    "ratio_to_routed": 0.5,
    "ratio_to_direct_echo": 1.4,
    "p99_to_p50": 2.0,
    "steps_per_s": 1500.0,
}
"""`steps_per_s`, the least, is of the hot pace."""


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
"""`own` takes about eight minutes, nearly all of it asleep."""


def run(*, pace: str = "hot") -> dict[str, Any]:
    """Measures loop and yardsticks in turn.

    Returns:
        pace, period_ms; camera_to_action_us past the router, through it (`ROUTED`) and every yardstick
        ({p50, p99}), the ratios of camera_to_action's p50 to theirs, p99_to_p50 of its own, steps_per_s and
        routed_steps_per_s, inference_us: medians of the rounds; targets, machine.

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

    names = (ROUTED, *YARDSTICKS)
    of_steps = (
        TARGETS if pace == "hot" else {k: v for k, v in TARGETS.items() if k != "steps_per_s"}
    )
    return {
        "pace": pace,
        "period_ms": round(1e3 * chosen.period_s),
        "rounds": chosen.rounds,
        "steps": sum(result["steps"] for result in measured),
        "camera_to_action_us": medians("camera_to_action_us"),
        **{name: medians(name) for name in names},
        "ratio_to": {name: ratio(name) for name in names},
        "p99_to_p50": round(
            statistics.median(
                r["camera_to_action_us"]["p99"] / r["camera_to_action_us"]["p50"] for r in measured
            ),
            2,
        ),
        **{
            name: statistics.median(result[name] for result in measured)
            for name in ("steps_per_s", "routed_steps_per_s")
        },
        "inference_us": medians("inference_us"),
        "targets": of_steps,
        "machine": measured_on,
    }


def _round(directory: Path, seed: int, pace: Pace) -> dict[str, Any]:
    past, routed, times = None, None, {}
    for by_router in (False, True) if seed % 2 else (True, False):  # neither is always the first
        summary, measured = _play(directory, seed, pace, by_router=by_router)
        if by_router:
            routed, times = summary, measured
        else:
            past = summary
    assert past is not None
    assert routed is not None
    return {
        "steps": past["transitions"],
        "camera_to_action_us": past["loop"]["camera_to_action_us"],
        ROUTED: routed["loop"]["camera_to_action_us"],
        "inference_us": past["edge"]["inference_us"],
        "steps_per_s": past["loop"]["steps_per_s"],
        "routed_steps_per_s": routed["loop"]["steps_per_s"],
        **{name: percentiles(np.array(each)) for name, each in times.items()},
    }


def _play(
    directory: Path, seed: int, pace: Pace, *, by_router: bool
) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """A run's summary, and the yardsticks through the router that it had, while that is there."""
    config = RunConfig.for_task(
        TASK, seed=seed, hidden_units=100, iterations=pace.iterations, episodes=pace.episodes,
        epochs=1, replay_iterations=1, pacing=pace.pacing,
    )  # fmt: skip
    folder = new_run(directory, config)
    endpoint, direct = private_endpoint(), private_endpoint()
    services = services_of_run(folder.run, config, directory, endpoint, by_router=by_router)
    core = services[0].core
    sizes = _message_bytes(config)
    echo = ["bpn_shared.bus.echo", "--answer-bytes", str(sizes[1])]
    echoes = [
        Service("echo", [*echo, "--connect", endpoint], core=core),
        Service("direct-echo", [*echo, "--listen", direct], core=core),
    ]
    supervisor = Supervisor([*services, *(echoes if by_router else [])], folder.logs)
    stop = threading.Event()
    try:
        supervisor.start()
        supervisor.wait("learner", stop)
        if supervisor.failure:
            raise RuntimeError(supervisor.failure)
        times: dict[str, list[float]] = {}
        if by_router:
            with yardsticks.on_core(core):
                times = yardsticks.measure(
                    endpoint, direct, TASK, sizes, count=pace.echoes, period_s=pace.period_s
                )
    finally:
        supervisor.stop()
    if not by_router and "past the router" not in (folder.logs / "edge-0.log").read_text():
        raise RuntimeError(f"robot and edge did not find each other past the router: {folder.logs}")
    return summarize(folder), times


def _message_bytes(config: RunConfig) -> tuple[int, int]:
    header = FrameHeader(FrameKind.MID, 0, 0, 0, 0, 0).encode()
    channels, height, width = config.task_spec.frame_shape
    action = Action(0, 0, 0, 0, 0, 0).encode()
    return len(header) + channels * height * width, len(action)


def met(result: dict[str, Any]) -> bool:
    """Whether the measurement reaches its targets."""
    found = {
        "ratio_to_routed": result["ratio_to"][ROUTED],
        "ratio_to_direct_echo": result["ratio_to"]["direct_echo_us"],
        "p99_to_p50": result["p99_to_p50"],
        "steps_per_s": -result["steps_per_s"],
    }
    return all(
        found[name] <= (-target if name == "steps_per_s" else target)
        for name, target in result["targets"].items()
    )


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    pace = f"one in {result['period_ms']} ms" if result["period_ms"] else "one after the other"
    title = (
        f"{result['steps']} steps in {result['rounds']} rounds, {pace}, {result['steps_per_s']:.0f} steps/s, "
        f"{result['routed_steps_per_s']:.0f} through the router"
    )
    host = result["machine"]
    caption = f"{host['cpu']}, {host['cores']} cores, load {host['load_average'][0]}"
    table = Table("what", "p50 us", "p99 us", "camera to action is", title=title, caption=caption)
    for name in ("camera_to_action_us", ROUTED, "inference_us", *YARDSTICKS):
        times = " ".join(f"{result[name][key]:8.1f}" for key in ("p50", "p99")).split()
        ratio = result["ratio_to"].get(name)
        table.add_row(name.removesuffix("_us"), *times, f"{ratio:.2f} x" if ratio else "")
    Console().print(table)
