"""Kernels and exported C on the processors of edge boards: by Debian's cross compilers, run in qemu."""

import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from compiled import compiled, expected, ran
from networks import awkward_blob, awkward_observation
from vectors import BLOBS, answers_of, records

from bpn.export.c_source import c_source
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.network import Convolution, NetworkSpec
from bpn_shared.spec.tasks import TaskOptions

ROOT = Path(__file__).parents[2]
EDGE, LEARNER = ROOT / "services/edge/src", ROOT / "services/learner/src"
WARNINGS = [
    "-O3",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Werror",
    "-Wno-psabi",
    "-Wno-maybe-uninitialized",
]
NETWORKS = 60
TARGETS = {
    "armv7": ("arm-linux-gnueabihf-", "qemu-arm"),
    "aarch64": ("aarch64-linux-gnu-", "qemu-aarch64"),
}


Case = tuple[WeightBlob, list[np.ndarray]]


def published() -> list[Case]:
    """The published vectors; that their answers are the golden model's, other tests hold."""
    blobs = [(WeightBlob.decode(path.read_bytes()), answers_of(path)) for path in BLOBS]
    return [(blob, [image for image, _ in records(blob, path)]) for blob, path in blobs]


def networks(count: int) -> list[Case]:
    """Of the paper's shape and of others, at their limits."""
    rng = np.random.default_rng(7)
    other = {"image_px": 40, "convolutions": (Convolution(5, 2, 9), Convolution(3, 2, 20))}
    found = []
    for index in range(count):
        spec = NetworkSpec(
            int(rng.integers(1, 17)), int(rng.integers(1, 257)), int(rng.integers(2, 33)),
            **({} if index % 2 else other),
        )  # fmt: skip
        found.append((awkward_blob(spec, rng), [awkward_observation(spec, rng) for _ in range(2)]))
    return found


@pytest.mark.parametrize("target", TARGETS)
def test_the_exported_c_is_exact(target: str, tmp_path: Path) -> None:
    prefix, emulator = TARGETS[target]
    task = task_spec("reaching", TaskOptions())
    for index, (blob, observations) in enumerate(published()):
        folder = tmp_path / str(index)
        folder.mkdir()
        names = tuple(f"action {number}" for number in range(blob.spec.actions))
        source = c_source(blob, task.model_copy(update={"action_names": names}))
        program = compiled(source, folder, [f"{prefix}gcc", "-static"])
        found = ran(program, observations, [emulator])
        for observation, row in zip(observations, found, strict=True):
            np.testing.assert_array_equal(row, expected(blob, observation))


def encoded(blob: WeightBlob, observations: list[np.ndarray]) -> bytes:
    """What kernel_driver.cpp reads."""
    layers = blob.spec.layers
    parts = [struct.pack("<i", len(layers))]
    for layer in layers:
        sizes = layer.in_size, layer.in_channels, layer.kernel, layer.stride, layer.out_channels
        parts.append(struct.pack("<5i", *sizes))
    parts += [signs.tobytes() for signs in blob.weights]
    parts += [tau.astype("<i4").tobytes() for tau in blob.thresholds]
    return b"".join(
        [*parts, struct.pack("<i", len(observations)), *(o.tobytes() for o in observations)]
    )


def told(blob: WeightBlob, observation: np.ndarray) -> list[str]:
    """What it writes of an observation, on one path."""
    *hidden, last = golden.forward(blob, observation)
    bits = [
        "".join("01"[int(on)] for on in (o >= tau).reshape(-1))
        for o, tau in zip(hidden, blob.thresholds, strict=True)
    ]
    return [*bits, " ".join(map(str, last.tolist()))]


def test_the_edges_kernel_is_exact_on_aarch64_on_every_path(tmp_path: Path) -> None:
    program = tmp_path / "kernel"
    sources = [
        EDGE / f"{name}.cpp" for name in ("packed_network", "paths", "path_neon", "path_portable")
    ]
    driver = Path(__file__).with_name("kernel_driver.cpp")
    subprocess.run(
        [
            "aarch64-linux-gnu-g++",
            "-std=c++17",
            "-static",
            *WARNINGS,
            f"-I{EDGE}",
            *sources,
            driver,
            "-o",
            program,
        ],
        check=True,
    )
    cases = published() + networks(NETWORKS)
    done = subprocess.run(
        ["qemu-aarch64", program], input=b"".join(encoded(*case) for case in cases),
        capture_output=True, check=True, timeout=600,
    )  # fmt: skip
    lines = iter(done.stdout.decode().splitlines())
    seen = set()
    for blob, observations in cases:
        variants = ["any", "paper"] if blob.spec.is_paper_shape else ["any"]
        for observation in observations:
            for path in ("neon", "portable"):
                for variant in variants:
                    seen.add((path, variant))
                    for line in told(blob, observation):
                        assert next(lines) == f"{path} {variant} {line}"
    assert next(lines, None) is None
    assert len(seen) == 4


@pytest.mark.parametrize("compiler", ["aarch64-linux-gnu-g++", "arm-linux-gnueabihf-g++"])
def test_the_learners_kernel_compiles_without_a_warning(compiler: str, tmp_path: Path) -> None:
    subprocess.run(
        [compiler, "-std=c++20", "-ffp-contract=fast", *WARNINGS, "-c", LEARNER / "path_portable.cpp",
         "-o", tmp_path / "path.o"],
        check=True,
    )  # fmt: skip
