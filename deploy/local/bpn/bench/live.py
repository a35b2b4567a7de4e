"""The live view's part of `bpn bench dashboard`: what watching costs the server, and what it costs the loop.

First four cameras of the largest frames at 28 a second, to one reader. Then a real run, with and without a
client that subscribes to everything and reads nothing, in turns: what differs between neighbouring windows
is the client's doing, and not the machine's mood.
"""

import contextlib
import itertools
import json
import os
import socket
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import numpy as np
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bpn.local_run import new_run, private_endpoint
from bpn.summary import percentiles
from bpn.supervisor import Service, Supervisor, services_of_run
from bpn_dashboard.hub.protocol import LiveFrame
from bpn_dashboard.hub.websocket import PATH
from bpn_dashboard.service import ADDRESS_FILE
from bpn_shared import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.bus.telemetry import TelemetryWatch
from bpn_shared.config import RunConfig
from bpn_shared.messages.preview import PreviewHeader
from bpn_shared.messages.telemetry import Telemetry
from bpn_shared.service import Counters

CAMERAS, FPS, CHANNELS = 4, 28.0, 6
CAMERA_S, DEAF_S, WINDOW_S, ROUNDS = 10.0, 30.0, 6.0, 10
SETTLE_S = 3.0
_START_S = 60.0
TARGETS = {"server_cpu_percent": 10.0, "steps_change_percent": 2.0, "server_growth_mb": 20.0}


def measure() -> dict[str, Any]:
    """Measures both parts.

    Returns:
        cameras: fps (of the slowest), server_cpu_percent and idle_cpu_percent (of one core),
        capture_to_client_ms {p50, p99}. deaf_client: steps_per_s without it, steps_change_percent (median over
        rounds), server_growth_mb within 30 s.
    """
    with tempfile.TemporaryDirectory(prefix="bpn-bench-") as directory:
        return {"cameras": _cameras(Path(directory)), "deaf_client": _deaf_client(Path(directory))}


def met(result: dict[str, Any]) -> bool:
    """Whether the measurement reaches its targets."""
    cameras, deaf = result["cameras"], result["deaf_client"]
    return bool(
        cameras["fps"] > FPS - 1
        and cameras["server_cpu_percent"] <= TARGETS["server_cpu_percent"]
        and abs(deaf["steps_change_percent"]) < TARGETS["steps_change_percent"]
        and deaf["server_growth_mb"] < TARGETS["server_growth_mb"]
    )


class _Dashboard:
    """A running dashboard."""

    def __init__(self, runs_dir: Path) -> None:
        address = _wait_for_json(runs_dir / ADDRESS_FILE)
        self._url = str(address["url"]).replace("http", "ws", 1) + PATH
        self._token = str(address["token"])
        self.process = psutil.Process(int(address["pid"]))

    def wait_until_live(self) -> None:
        """Waits until the dashboard has reached the router.

        Raises:
            TimeoutError: it did not.
        """
        deadline_s = time.monotonic() + _START_S
        while time.monotonic() < deadline_s:
            with contextlib.suppress(ConnectionClosed, OSError), self.client():
                return
            time.sleep(0.1)
        raise TimeoutError(f"the dashboard at {self._url} does not reach the router")

    @contextlib.contextmanager
    def client(self, **options: Any) -> Iterator[ClientConnection]:
        """A client that was made welcome.

        Raises:
            ConnectionClosed: it was sent away.
        """
        headers = {"Authorization": f"Bearer {self._token}"}
        with connect(
            self._url, compression=None, additional_headers=headers, **options
        ) as connection:
            connection.send(json.dumps({"op": "hello", "proto": 1}))
            connection.recv(timeout=_START_S)
            yield connection

    @property
    def address(self) -> tuple[str, int]:
        host, _, port = self._url.split("/")[2].rpartition(":")
        return host, int(port)


def _wait_for_json(path: Path) -> dict[str, Any]:
    deadline_s = time.monotonic() + _START_S
    while time.monotonic() < deadline_s:
        with contextlib.suppress(OSError, json.JSONDecodeError):
            found: dict[str, Any] = json.loads(path.read_bytes())
            return found
        time.sleep(0.05)
    raise TimeoutError(f"the dashboard did not write {path}")


def _dashboard_service(runs_dir: Path, endpoint: str) -> Service:
    return Service(
        "dashboard",
        ["bpn_dashboard", "--runs-dir", str(runs_dir), "--connect", endpoint, "--port", "0"],
    )


@contextlib.contextmanager
def _running(services: list[Service], logs: Path) -> Iterator[None]:
    supervisor = Supervisor(services, logs)
    try:
        supervisor.start()
        yield
    finally:
        supervisor.stop()


def _subscribe(client: ClientConnection, topics: list[str], **more: Any) -> None:
    for number, topic in enumerate(topics):
        client.send(json.dumps({"op": "sub", "id": number, "topic": topic, **more}))


# Four cameras


def _cameras(directory: Path) -> dict[str, Any]:
    runs_dir, endpoint = directory / "cameras", private_endpoint()
    runs_dir.mkdir()
    router = Service("router", ["bpn_shared.bus.router", "--listen", endpoint])
    with _running([router, _dashboard_service(runs_dir, endpoint)], runs_dir / "logs"):
        dashboard = _Dashboard(runs_dir)
        run, stop = uuid4(), threading.Event()
        dashboard.wait_until_live()
        with dashboard.client() as client:
            time.sleep(SETTLE_S)
            idle_percent = _cpu_percent(dashboard.process, CAMERA_S / 2)
            robots = threading.Thread(target=_show, args=(endpoint, run, stop))
            robots.start()
            try:
                _subscribe(client, [f"camera/{run}/{slot}" for slot in range(CAMERAS)], rate_hz=30)
                return _watch(client, dashboard.process) | {"idle_cpu_percent": idle_percent}
            finally:
                stop.set()
                robots.join()


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


def _watch(client: ClientConnection, server: psutil.Process) -> dict[str, Any]:
    _read_frames(client, SETTLE_S)
    before = server.cpu_times()
    start_s = time.monotonic()
    counts, ages_ms = _read_frames(client, CAMERA_S)
    seconds, after = time.monotonic() - start_s, server.cpu_times()
    cpu_s = after.user + after.system - before.user - before.system
    return {
        "fps": round(min(counts) / seconds, 2),
        "server_cpu_percent": round(100 * cpu_s / seconds, 2),
        "capture_to_client_ms": percentiles(np.array(ages_ms)),
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
    return round(float(process.cpu_percent(seconds)), 2)


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


def _deaf_client(directory: Path) -> dict[str, Any]:
    runs_dir, endpoint = directory / "deaf", private_endpoint()
    # one endless iteration: between two, there would be pauses for learning
    config = RunConfig.for_task("reaching", nodes=100, iterations=1, episodes=10_000)
    folder = new_run(runs_dir, config)
    services = services_of_run(folder.run, config, runs_dir, endpoint)
    with (
        _running([*services, _dashboard_service(runs_dir, endpoint)], folder.logs),
        Bus(endpoint) as bus,
    ):
        dashboard, steps = _Dashboard(runs_dir), _Steps(bus)
        steps.wait_for_first()
        dashboard.wait_until_live()
        with dashboard.client():
            time.sleep(SETTLE_S)  # whatever is loaded for the first client is there
        before_bytes = dashboard.process.memory_info().rss
        with _deaf(dashboard, folder.run):
            growths = []
            for _ in range(int(DEAF_S)):
                time.sleep(1.0)
                growths.append(dashboard.process.memory_info().rss - before_bytes)
        without, ratios = [steps.per_second(WINDOW_S)], []
        for _ in range(ROUNDS):
            with _deaf(dashboard, folder.run):
                watched = steps.per_second(WINDOW_S)
            without.append(steps.per_second(WINDOW_S))
            ratios.append(watched / statistics.mean(without[-2:]))
        steps.close()
    return {
        "steps_per_s": round(statistics.median(without), 1),
        "steps_change_percent": round(100 * (statistics.median(ratios) - 1), 2),
        "rounds_percent": [round(100 * (ratio - 1), 2) for ratio in ratios],
        "server_growth_mb": round(max(growths) / 1e6, 2),
    }


@contextlib.contextmanager
def _deaf(dashboard: _Dashboard, run: UUID) -> Iterator[None]:
    """A client that asks for everything of a run and takes nothing, not even into a large socket buffer."""
    link = socket.create_connection(dashboard.address)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    everything = [
        *(f"{topic}/{run}/0" for topic in ("camera", "actions")),
        *(f"{topic}/{run}" for topic in ("metrics", "logs")),
        *("runs", "topology"),
    ]
    with dashboard.client(sock=link, max_queue=1, ping_interval=None, close_timeout=0.1) as client:
        _subscribe(client, everything)
        yield
