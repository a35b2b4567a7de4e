"""`bpn bench kernel`: one inference of the policy on one core, beside float32 in ONNX Runtime and torch.

Every native path is first checked for exactness. The candidates take turns in each round, so that what
else the machine does meets all of them; reported are the medians of the rounds. The peers compute the
same geometry with float weights, biases and ReLU, and are given their input as float32 already.
"""

import statistics
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from time import perf_counter_ns
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from bpn.bench.machine import machine, one_core
from bpn.bench.peers import FloatNetwork, onnxruntime_inference, torch_inference
from bpn_edge.kernel import Kernel
from bpn_edge.kernel.golden import GoldenKernel
from bpn_edge.kernel.native import NativeKernel, available_paths
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.errors import InputError
from bpn_shared.spec.network import NetworkSpec, parse_convolutions

SPEC = NetworkSpec(
    channels=6, hidden_units=100, actions=17
)  # the pan-tilt task of the paper's section VI
ROUNDS = 15
EXACTNESS_CHECKS = 20
TARGET_SPEEDUP = 10.0
_ROUND_NS = 20_000_000
_CALLS = range(10, 2001)

Inference = Callable[[], object]


def run(
    repeats: int = ROUNDS, *, conv: str | None = None, image_px: int | None = None
) -> dict[str, Any]:
    """Checks and measures all candidates.

    Args:
        repeats: rounds.
        conv: convolutions in place of the paper's, as `parse_convolutions` reads them.
        image_px: rows and columns of an image in place of the paper's.

    Returns:
        network, rounds, exactness_checks of each native path, candidates (name to p50_us, p99_us and
        ratio to the best native path), speedup over ONNX Runtime and its target, versions, machine.

    Raises:
        InputError: the network is impossible.
        RuntimeError: a native path differs from the reference, or a peer is not installed.
    """
    spec = _spec(conv, image_px)
    rng = np.random.default_rng(0)
    for path in available_paths():
        _check_exactness(spec, path, rng)
    measured_on = machine()  # its load before the measurement adds its own
    with one_core():
        candidates = _candidates(spec, rng)
        rounds = [
            {name: _time_us(call) for name, call in candidates.items()} for _ in range(repeats)
        ]
    native = f"native {available_paths()[0]}"
    results = {
        name: {
            "p50_us": _median(times[name]["p50"] for times in rounds),
            "p99_us": _median(times[name]["p99"] for times in rounds),
            "ratio": _median(times[name]["p50"] / times[native]["p50"] for times in rounds),
        }
        for name in candidates
    }
    return {
        "network": str(spec),
        "rounds": repeats,
        "exactness_checks": EXACTNESS_CHECKS,
        "candidates": results,
        "speedup_over_onnxruntime": results["onnxruntime float32"]["ratio"],
        "target_speedup": TARGET_SPEEDUP if spec == SPEC else None,
        "versions": {name: version(name) for name in ("numpy", "onnxruntime", "torch")},
        "machine": measured_on,
    }


def _median(values: Iterable[float]) -> float:
    return round(statistics.median(values), 2)


def _spec(conv: str | None, image_px: int | None) -> NetworkSpec:
    try:
        convolutions = SPEC.convolutions if conv is None else parse_convolutions(conv)
        return replace(SPEC, convolutions=convolutions, image_px=image_px or SPEC.image_px)
    except ValueError as error:
        raise InputError(str(error)) from error


def _check_exactness(spec: NetworkSpec, path: str, rng: np.random.Generator) -> None:
    kernel = NativeKernel(path)
    for _ in range(EXACTNESS_CHECKS):
        blob, observation = WeightBlob.random(spec, rng), _observation(spec, rng)
        kernel.load(blob)
        if not np.array_equal(kernel.run(observation), golden.forward(blob, observation)[-1]):
            raise RuntimeError(
                f"native path {path!r} differs from the reference: do not use it here"
            )


def _candidates(spec: NetworkSpec, rng: np.random.Generator) -> dict[str, Inference]:
    blob, observation = WeightBlob.random(spec, rng), _observation(spec, rng)
    kernels: dict[str, Kernel] = {
        f"native {path}": NativeKernel(path) for path in available_paths()
    }
    kernels["golden"] = GoldenKernel()
    calls: dict[str, Inference] = {}
    for name, kernel in kernels.items():
        kernel.load(blob)
        calls[name] = partial(kernel.run, observation)
    network, pixels = FloatNetwork.random(spec, rng), observation.astype(np.float32)[np.newaxis]
    onnx, torch = onnxruntime_inference(network, pixels), torch_inference(network, pixels)
    np.testing.assert_allclose(onnx(), torch(), rtol=1e-2, atol=1e-2)  # the peers do the same work
    return {**calls, "onnxruntime float32": onnx, "torch float32": torch}


def _observation(spec: NetworkSpec, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    return rng.integers(0, 256, spec.observation_shape, dtype=np.uint8)


def _time_us(call: Inference) -> dict[str, float]:
    start_ns = perf_counter_ns()
    call()  # also warms the caches up again
    once_ns = perf_counter_ns() - start_ns
    calls = min(max(_ROUND_NS // once_ns, _CALLS.start), _CALLS[-1])
    times_ns = np.empty(calls)
    for index in range(calls):
        start_ns = perf_counter_ns()
        call()
        times_ns[index] = perf_counter_ns() - start_ns
    p50_ns, p99_ns = np.percentile(times_ns, (50, 99))
    return {"p50": p50_ns / 1e3, "p99": p99_ns / 1e3}


def met(result: dict[str, Any]) -> bool:
    """Whether the measurement reaches its targets."""
    target = result["target_speedup"]
    return target is None or bool(result["speedup_over_onnxruntime"] >= target)


def show(result: dict[str, Any]) -> None:
    """Prints the measurement as a table."""
    table = Table(
        "kernel", title=f"µs per inference, {result['network']}, one core", caption=_caption(result)
    )
    for heading in ("p50", "p99", "x native"):
        table.add_column(heading, justify="right")
    for name, times in result["candidates"].items():
        table.add_row(name, *(f"{times[key]:.1f}" for key in ("p50_us", "p99_us", "ratio")))
    Console().print(table)


def _caption(result: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    load = result["machine"]["load_average"][0]
    return f"{result['machine']['cpu']}, load {load}, {versions}"
