"""Kernels and exported C on the processors of edge boards: by Debian's cross compilers, run in qemu."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from compiled import compiled, expected, ran
from kernel_library import built
from networks import awkward_blob, awkward_observation
from vectors import BLOBS, VECTORS, answers_of, records

from bpn.export.c_source import c_source
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.installed import task_spec
from bpn_shared.spec.network import Convolution, NetworkSpec
from bpn_shared.spec.tasks import TaskOptions

ROOT = Path(__file__).parents[2]
LEARNER = ROOT / "services/learner/src"
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


def told(blob: WeightBlob, observation: np.ndarray) -> list[str]:
    """What bpn-infer writes of an observation with --trace, but for the best choices."""
    *hidden, last = golden.forward(blob, observation)
    bits = [
        "".join("01"[int(on)] for on in (o >= tau).reshape(-1))
        for o, tau in zip(hidden, blob.thresholds, strict=True)
    ]
    return [*bits, " ".join(map(str, last.tolist()))]


# Which of its own processors qemu is, and the paths that those have. Cortex-A53 is the Ultra96's, Cortex-A76 the
# Raspberry Pi 5's.
PROCESSORS = {
    "aarch64": {
        "cortex-a53": ["neon", "portable"],
        "cortex-a76": ["neon-dot", "neon", "portable"],
        "max": ["neon-i8mm", "neon-dot", "neon", "portable"],
    },
    "armv7": {"cortex-a7": ["portable"]},
}


@pytest.mark.parametrize("target", TARGETS)
def test_the_edges_kernel_is_exact_from_c_on_every_path(target: str, tmp_path: Path) -> None:
    prefix, emulator = TARGETS[target]
    library = built(
        tmp_path / "kernel",
        "CMAKE_BUILD_TYPE=Release", "CMAKE_SYSTEM_NAME=Linux", "CMAKE_EXE_LINKER_FLAGS=-static",
        f"CMAKE_SYSTEM_PROCESSOR={prefix.partition('-')[0]}",
        f"CMAKE_C_COMPILER={prefix}gcc", f"CMAKE_CXX_COMPILER={prefix}g++",
    )  # fmt: skip

    def said(processor: str, *arguments: str | Path) -> list[str]:
        command = [emulator, "-cpu", processor, library / "bpn-infer", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600)
        return done.stdout.splitlines()

    for processor, paths in PROCESSORS[target].items():
        assert said(processor, "--paths") == paths
    most = max(PROCESSORS[target], key=lambda name: len(PROCESSORS[target][name]))
    files = [path.read_bytes() for path in BLOBS]  # in schema 1, some of them
    random = networks(NETWORKS)
    cases = zip(
        [*files, *(blob.encode() for blob, _ in random)], [*published(), *random], strict=True
    )
    for data, (blob, observations) in cases:
        (tmp_path / "blob").write_bytes(data)
        (tmp_path / "pixels").write_bytes(b"".join(image.tobytes() for image in observations))
        expected_lines = [line for image in observations for line in told(blob, image)]
        for path in PROCESSORS[target][most]:
            found = said(most, tmp_path / "blob", tmp_path / "pixels", "--trace", "--path", path)
            assert [line.partition(" :")[0] for line in found] == expected_lines, path
    for path in VECTORS.glob("refused/*.bpnw"):
        with pytest.raises(subprocess.CalledProcessError) as refused:
            said(most, path)
        assert refused.value.returncode == 2


@pytest.mark.parametrize("compiler", ["aarch64-linux-gnu-g++", "arm-linux-gnueabihf-g++"])
def test_the_learners_kernel_compiles_without_a_warning(compiler: str, tmp_path: Path) -> None:
    subprocess.run(
        [compiler, "-std=c++20", "-ffp-contract=fast", *WARNINGS, "-c", LEARNER / "path_portable.cpp",
         "-o", tmp_path / "path.o"],
        check=True,
    )  # fmt: skip
