"""How long each computer takes from an image to its action, broken down as the paper's Table IV."""

import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn.bench.peers import FloatNetwork
from bpn.local_run import RunFailedError
from bpn.reproduce.definition import StoppedError
from bpn.reproduce.remote_policy import CONFIG, Breakdown, FarClient, Policy, binarized_policy
from bpn.supervisor import Service, Supervisor
from bpn_edge.kernel import load
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.onnx_model import onnx_model
from bpn_shared.bus.session import Bus, prepare_process

EDGE, EDGE_CPU, EDGE_GOLDEN = "edge, native", "edge CPU, ONNX float32", "edge CPU, golden numpy"
SERVER = "server over Zenoh"

_WARM_UP, _WARM_UP_S = 5, 30.0


def measure(images: int, stop: threading.Event) -> dict[str, dict[str, Any]]:
    """Gives every computer one image in turn, one in each of the robot's control periods.

    Returns:
        For each computer send_us, compute_us, receive_us and total_us, each {p50, p99}; send and receive
        are 0 at the edge.

    Raises:
        RunFailedError: the far process does not answer.
        StoppedError: `stop` was set.
    """
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (images, *CONFIG.task_spec.frame_shape), np.uint8)
    network = FloatNetwork.random(CONFIG.network, rng)
    model = onnx_model(network.spec, network.weights, network.biases)
    floats = FloatWeights(network.spec, model, np.zeros(network.spec.actions, np.float32))
    policies = {
        EDGE: binarized_policy("native"),
        EDGE_CPU: Policy(load("onnx"), floats),
        EDGE_GOLDEN: binarized_policy("golden"),
    }
    times: dict[str, list[Breakdown]] = {name: [] for name in (*policies, SERVER)}
    with far_client(stop) as client:
        for frame in frames:
            for name, policy in policies.items():
                start_ns = time.perf_counter_ns()
                policy.act(frame)
                times[name].append(Breakdown(0.0, (time.perf_counter_ns() - start_ns) / 1e3, 0.0))
            answer = client.ask(frame, CONFIG.task_spec.control_period_s)
            if answer is not None:
                times[SERVER].append(answer)
            if stop.wait(CONFIG.task_spec.control_period_s):
                raise StoppedError("the computers were being timed")
    if not times[SERVER]:
        raise RunFailedError("the far process answered no image")
    return {name: _percentiles(np.array(rows)) for name, rows in times.items()}


def _percentiles(rows: npt.NDArray[np.float64]) -> dict[str, Any]:
    """Of send, compute, receive (float64[images, 3]) and of their sum."""
    columns = {
        "send_us": rows[:, 0], "compute_us": rows[:, 1], "receive_us": rows[:, 2],
        "total_us": rows.sum(axis=1),
    }  # fmt: skip
    return {
        name: {
            key: round(float(value), 1)
            for key, value in zip(("p50", "p99"), np.percentile(values, (50, 99)), strict=True)
        }
        for name, values in columns.items()
    }


@contextmanager
def far_client(stop: threading.Event) -> Iterator[FarClient]:
    """A router on loopback TCP, a far process and a client that it has answered already.

    Raises:
        RunFailedError: the far process does not come up.
    """
    prepare_process()
    endpoint = _free_tcp_endpoint()
    services = [
        Service("router", ["bpn_shared.bus.router", "--listen", endpoint]),
        Service("far", ["bpn.reproduce.remote_policy", "--connect", endpoint]),
    ]
    with tempfile.TemporaryDirectory(prefix="bpn-far-") as logs:
        supervisor = Supervisor(services, Path(logs))
        try:
            supervisor.start()
            with Bus(endpoint, stop=stop) as bus:
                client = FarClient(bus)
                _warm_up(client, supervisor, stop)
                yield client
        finally:
            supervisor.stop()


def _warm_up(client: FarClient, supervisor: Supervisor, stop: threading.Event) -> None:
    frame = np.zeros(CONFIG.task_spec.frame_shape, np.uint8)
    deadline_s, answers = time.monotonic() + _WARM_UP_S, 0
    while answers < _WARM_UP:
        supervisor.check()
        if stop.is_set():
            raise StoppedError("the far process was starting")
        if supervisor.failure or time.monotonic() > deadline_s:
            raise RunFailedError(supervisor.failure or f"no answer within {_WARM_UP_S:.0f} s")
        answers += client.ask(frame, 0.1) is not None


def _free_tcp_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
