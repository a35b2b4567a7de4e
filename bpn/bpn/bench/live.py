"""The live view's part of `bpn bench dashboard`: what watching costs the server, and what it costs the loop.

First four cameras of the largest frames at 28 a second, to one reader. Then a real run, with and without a
client that subscribes to everything and reads nothing, in turns: a window with it is compared with the
mean of the windows before and after, so that what the machine does besides falls on both sides. The median
of these ratios is told with its 95 % confidence interval from order statistics, which assumes nothing of
how they are distributed; more rounds are made until the interval is narrow enough to tell.
"""

import contextlib
import itertools
import json
import math
import os
import socket
import statistics
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import numpy as np
import psutil
from websockets.sync.client import ClientConnection

from bpn.bench.figures import Figure, results
from bpn.bench.served import Served, router, serving
from bpn.bench.sizes import Sizes
from bpn.local_run import new_run, private_endpoint
from bpn.summary import percentiles
from bpn.supervisor import services_of_run
from bpn_dashboard.hub.protocol import LiveFrame
from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.counters import Counters
from bpn_shared.messages.preview import PreviewHeader
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.spec.config import RunConfig

CAMERAS, FPS, CHANNELS = 4, 28.0, 6
SETTLE_S = 3.0
_START_S = 60.0
_CONFIDENCE = 0.95

CAMERA_FIGURES = (
    Figure("camera_fps", f"{CAMERAS} cameras: frames a second, the slowest", FPS - 1, "least"),
    Figure("camera_cpu_percent", "  the server, % of a core", 10.0),
    Figure("camera_idle_cpu_percent", "  the server with nothing to show, % of a core"),
    Figure("camera_p50_ms", "  capture to client, median, ms", 30.0),
    Figure("camera_p99_ms", "  capture to client, 99th percentile, ms", 100.0),
)
STEPS_CHANGE_PERCENT = 2.0
STEPS = Figure(
    "deaf_steps_percent",
    "a client that reads nothing: change of the loop's steps/s, %",
    STEPS_CHANGE_PERCENT,
    "within",
    digits=2,
)
DEAF_FIGURES = (
    Figure("deaf_growth_mb", "  growth of the server's memory, MB", 20.0),
    Figure("deaf_steps_per_s", "  the loop's steps/s without it"),
)


# Four cameras


def measure_cameras(runs_dir: Path, sizes: Sizes) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """`CAMERA_FIGURES`."""
    endpoint, run, stop = private_endpoint(), uuid4(), threading.Event()
    with serving(runs_dir, endpoint, [router(endpoint)]) as served, served.live() as client:
        time.sleep(SETTLE_S)
        idle_percent = _cpu_percent(served.process, sizes.camera_s / 2)
        robots = threading.Thread(target=_show, args=(endpoint, run, stop))
        robots.start()
        try:
            _subscribe(client, [f"camera/{run}/{slot}" for slot in range(CAMERAS)], rate_hz=30)
            values = _watch(client, served.process, sizes.camera_s)
        finally:
            stop.set()
            robots.join()
    values["camera_idle_cpu_percent"] = idle_percent
    return results(CAMERA_FIGURES, values), values


def _show(endpoint: str, run: UUID, stop: threading.Event) -> None:
    """Four robots' previews, in step."""
    pixels = os.urandom(CHANNELS * 84 * 84)
    with Bus(endpoint, stop=stop) as bus:
        cameras = [LatestPublisher(bus, keys.preview(run, s), "frame") for s in range(CAMERAS)]
        start_s = time.monotonic()
        for step in itertools.count():
            for camera in cameras:
                camera.put(pixels, PreviewHeader(CHANNELS, 2, 0, 0, step, time.time_ns()).encode())
            if stop.wait(max(0.0, start_s + (step + 1) / FPS - time.monotonic())):
                return


def _watch(client: ClientConnection, server: psutil.Process, watch_s: float) -> dict[str, float]:
    _read_frames(client, SETTLE_S)
    before = server.cpu_times()
    start_s = time.monotonic()
    counts, ages_ms = _read_frames(client, watch_s)
    seconds, after = time.monotonic() - start_s, server.cpu_times()
    cpu_s = after.user + after.system - before.user - before.system
    ages = percentiles(np.array(ages_ms))
    return {
        "camera_fps": min(counts) / seconds,
        "camera_cpu_percent": 100 * cpu_s / seconds,
        "camera_p50_ms": ages["p50"],
        "camera_p99_ms": ages["p99"],
    }


def _read_frames(client: ClientConnection, seconds: float) -> tuple[list[int], list[float]]:
    """Reads and acknowledges; frames per camera, and each one's age on arrival, milliseconds."""
    counts, ages_ms = [0] * CAMERAS, []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        message = client.recv(timeout=5)
        if isinstance(message, bytes):
            frame, _ = LiveFrame.decode(message)
            ages_ms.append(1e3 * (time.time() - frame.t_capture_unix_s))
            counts[frame.subscription] += 1
            client.send(json.dumps({"op": "ack", "id": frame.subscription, "seq": frame.seq}))
    return counts, ages_ms


def _cpu_percent(process: psutil.Process, seconds: float) -> float:
    process.cpu_percent()
    return float(process.cpu_percent(seconds))


def _subscribe(client: ClientConnection, topics: list[str], **more: Any) -> None:
    for number, topic in enumerate(topics):
        client.send(json.dumps({"op": "sub", "id": number, "topic": topic, **more}))


# A client that reads nothing


class _Steps:
    """Counts the run's steps, by what its robot tells of the frames that it sent."""

    def __init__(self, bus: Bus) -> None:
        self._told: list[tuple[float, int]] = []
        self._watch = TelemetryWatch(bus, self._hear, Counters())

    def _hear(self, report: Telemetry) -> None:
        for traffic in report.traffic:
            if traffic.direction == "sent" and traffic.key.endswith("/frame"):
                self._told.append((report.time_ns / 1e9, traffic.messages))

    def wait_for_first(self) -> None:
        """Waits until the run is under way.

        Raises:
            TimeoutError: it did not begin.
        """
        deadline_s = time.monotonic() + _START_S
        while not self._told or self._told[-1][1] < 100:
            if time.monotonic() > deadline_s:
                raise TimeoutError("the run did not begin")
            time.sleep(0.1)

    def per_second(self, seconds: float) -> float:
        """Steps a second over the next `seconds`."""
        time.sleep(seconds)
        told = [(t_s, count) for t_s, count in self._told if t_s >= time.time() - seconds]
        (first_s, first), (last_s, last) = told[0], told[-1]
        return float(last - first) / (last_s - first_s)

    def close(self) -> None:
        self._watch.close()


def measure_deaf_client(
    runs_dir: Path, sizes: Sizes
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """`STEPS`, with how sure it is, and `DEAF_FIGURES`."""
    endpoint = private_endpoint()
    # one endless iteration: between two, there would be pauses for learning
    config = RunConfig.for_task("reaching", hidden_units=100, iterations=1, episodes=10_000)
    folder = new_run(runs_dir, config)
    services = services_of_run(folder.run, config, runs_dir, endpoint)
    with serving(runs_dir, endpoint, services) as served, Bus(endpoint) as bus:
        steps = _Steps(bus)
        steps.wait_for_first()
        with served.live():
            time.sleep(SETTLE_S)  # whatever is loaded for the first client is there
        growth_bytes = _growth(served, folder.run, sizes.deaf_s)
        without, ratios = _in_turns(served, folder.run, steps, sizes)
        steps.close()
    percents = [100 * (ratio - 1) for ratio in ratios]
    told = [STEPS.result(statistics.median(percents), median_interval(percents))]
    values = {
        "deaf_growth_mb": growth_bytes / 1e6,
        "deaf_steps_per_s": statistics.median(without),
    }
    samples = {"steps_per_s": without, "change_percent": percents}
    return told + results(DEAF_FIGURES, values), samples


def _growth(served: Served, run: UUID, seconds: float) -> int:
    """The most that the server's memory grows by while a client reads nothing."""
    before = served.process.memory_info().rss
    growths: list[int] = []
    with _deaf(served, run):
        for _ in range(max(1, round(seconds))):
            time.sleep(1.0)
            growths.append(served.process.memory_info().rss - before)
    return max(growths)


def _in_turns(
    served: Served, run: UUID, steps: _Steps, sizes: Sizes
) -> tuple[list[float], list[float]]:
    """Steps a second in the windows without the client, and the ratio of each with it to its neighbours."""
    without, ratios = [steps.per_second(sizes.window_s)], list[float]()
    fewest, most = sizes.rounds
    while len(ratios) < fewest or (len(ratios) < most and not _is_narrow(ratios)):
        with _deaf(served, run):
            watched = steps.per_second(sizes.window_s)
        without.append(steps.per_second(sizes.window_s))
        ratios.append(watched / statistics.mean(without[-2:]))
    return without, ratios


def _is_narrow(ratios: Sequence[float]) -> bool:
    """Whether the interval is half as wide as what it shall tell; never depends on where it lies."""
    interval = median_interval(ratios)
    return interval is not None and 100 * (interval[1] - interval[0]) < STEPS_CHANGE_PERCENT


def median_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """The 95 % confidence interval of the median, by order statistics; None of fewer than six values."""
    ordered, n = sorted(values), len(values)
    cut, outside = 0, 2.0 / 2**n  # the chance that the median lies beyond the outermost values
    while outside <= 1 - _CONFIDENCE:
        cut += 1
        outside += 2 * math.comb(n, cut) / 2**n
    return (ordered[cut - 1], ordered[n - cut]) if cut else None


@contextlib.contextmanager
def _deaf(served: Served, run: UUID) -> Iterator[None]:
    """A client that asks for everything of a run and takes nothing, not even into a large socket buffer."""
    link = socket.create_connection(served.host_and_port)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    everything = [
        *(f"{topic}/{run}/0" for topic in ("camera", "actions")),
        *(f"{topic}/{run}" for topic in ("metrics", "logs")),
        *("runs", "topology"),
    ]
    with served.live(sock=link, max_queue=1, ping_interval=None, close_timeout=0.1) as client:
        _subscribe(client, everything)
        yield
