"""Documents of `bpn reproduce`, made by hand."""

from typing import Any

from bpn.reproduce import averaging, computers, report
from bpn.reproduce.latency import DELAYS_MS
from bpn.reproduce.targets import TARGETS

SEEDS, ITERATIONS = 3, 12


def record(
    algorithm: str, hidden_units: int, seed: int, *, alpha: float = 0.95, lost: int = 0
) -> dict[str, Any]:
    return {
        "run_id": f"{algorithm}-{hidden_units}-{seed}", "task": "tracking", "algorithm": algorithm,
        "hidden_units": hidden_units, "alpha": alpha, "seed": seed, "steps": 40, "episodes": 10, "frame_skip": 1,
        "returns_px": [-800.0 + 10 * seed - i for i in range(ITERATIONS)],
        "lengths": [40.0 - lost] * ITERATIONS, "failures": [lost] * ITERATIONS,
        "seconds": 60.0, "weights_sha256": "00",
    }  # fmt: skip


def trials(**names: Any) -> dict[str, Any]:
    return names | {
        "trials": 2, "return_px": {"mean": -200.0, "std": 1.0}, "px_per_step": {"mean": -2.5, "std": 0.1},
        "length": {"mean": 80.0, "std": 0.0}, "tracking_time": {"steps": 80, "seconds": 11.6, "percent": 100.0},
        "success_share": 0.5, "deadline_misses": 3, "successes": [True, False], "lengths": [80, 80],
        "gaze_deg": [[[0.0, 0.0], [2.0, 2.0]]],
    }  # fmt: skip


def learning() -> tuple[list[dict[str, Any]], dict[str, Any]]:
    runs = [
        record(algorithm, hidden_units, seed, lost=2 if algorithm == "bqn" else 0)
        for seed in range(SEEDS)
        for algorithm, hidden_units in [
            ("bpn", 32),
            ("bpn", 100),
            ("bqn", 32),
            ("bqn", 100),
            ("cvi", 100),
        ]
    ]
    lines = [{"name": "optimum", "return_px": -770.0, "length": 40, "full_length_share": 1.0}]
    return runs, {"references": lines}


def times(total_us: float) -> dict[str, Any]:
    part = {"p50": total_us, "p99": 2 * total_us}
    return dict.fromkeys(("send_us", "compute_us", "receive_us", "total_us"), part)


RESULTS: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "reaching": learning(),
    "tracking": learning(),
    "heatmap": (
        [record("bpn", n, s, alpha=a) for s in range(SEEDS) for n in (16, 32) for a in (0.0, 0.95)],
        {},
    ),
    "pan-tilt": (
        [record(algorithm, 100, seed) for seed in range(SEEDS) for algorithm in ("bpn", "bqn")],
        {
            "trials": [
                trials(name="random", seed=0),
                *(trials(name="bpn", seed=seed) for seed in range(SEEDS)),
                trials(name="bqn", seed=0),
            ]
        },
    ),
    "inference": (
        [],
        {
            "network": "C=6",
            "candidates": {
                "native avx2": {"p50_us": 8.0, "p99_us": 9.0},
                "golden": {"p50_us": 800.0, "p99_us": 900.0},
            },
        },
    ),
    "latency": (
        [record("bpn", 100, seed) for seed in range(SEEDS)],
        {
            "computers": {computers.EDGE: times(40.0), computers.SERVER: times(800.0)},
            "image_bytes": 21168,
            "camera_to_action_us": {"p50": 500.0, "p99": 900.0},
            "trials": [
                trials(algorithm="bpn", seed=seed, delay_ms=delay_ms)
                for seed in range(SEEDS)
                for delay_ms in DELAYS_MS
            ],
        },
    ),
}

RESULTS["averaging"] = (
    [],
    {
        "optimum_px": -80.8,
        "iterations": 50,
        "cells": [
            {
                "update": update, "kind": kind, "sigma": sigma, "nodes": nodes,
                "returns_px": [-90.0, -100.0] if sigma else [-81.0],
            }
            for update in averaging.UPDATES
            for kind, sigma, nodes in [
                *((kind, sigma, 0) for kind in averaging.KINDS for sigma in averaging.SIGMAS),
                *(("fresh", 0.0, nodes) for nodes in averaging.NODES),
            ]
        ],
    },
)  # fmt: skip
RESULTS["cartpole"] = (
    [
        {k: v for k, v in record("bpn", 128, seed).items() if k != "returns_px"}
        | {"returns": [20.0 + i for i in range(ITERATIONS)]}
        for seed in range(SEEDS)
    ],
    {
        "trials": [
            {
                "name": name, "seed": seed, "trials": 2, "return": {"mean": 20.0, "std": 1.0},
                "returns": [19.0, 21.0], "successes": [False, True],
            }
            for name, seed in (("random", 0), *(("bpn", seed) for seed in range(SEEDS)))
        ]
    },
)  # fmt: skip
RESULTS["robustness"] = (
    [record(algorithm, 256, seed) for seed in range(SEEDS) for algorithm in ("bpn", "cvi")],
    {
        "trained_for": "noise=0..30",
        "trials": [
            {
                "algorithm": algorithm, "seed": seed, "augmented": augmented, "level": level, "trials": 4,
                "kept": 3 if augmented else 0, "return_px": -800.0,
            }
            for seed in range(SEEDS)
            for algorithm in ("bpn", "cvi")
            for augmented in (False, True)
            for level in ("", "noise=25")
        ],
    },
)  # fmt: skip

RESULTS["robustness-pan-tilt"] = RESULTS["robustness"]


def made(name: str, *, quick: bool = False) -> dict[str, Any]:
    runs, result = RESULTS[name]
    document = report.document(TARGETS[name], f"bpn reproduce {name}", [], result, quick=quick)
    return document | {"runs": runs}
