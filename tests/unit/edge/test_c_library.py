"""The kernel from C: exact on every layer and path, refuses what the decoder does, takes memory only to load."""

import hashlib
import struct
import subprocess
from pathlib import Path

import kernel_library
import numpy as np
import pytest
from kernel_library import SANITIZED, built, linked
from vectors import BLOBS, VECTORS, answers_of, records

from bpn_edge.kernel.native import available_paths
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError

SUPPORT = Path(kernel_library.__file__).parent
REFUSED = sorted(VECTORS.glob("refused/*.bpnw"))
CHANGED = 3000
"""Changed blobs, most of them with the right digest."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("kernel"))


@pytest.fixture(scope="module")
def sanitized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The portable path with the sanitizers in it; `make test-sanitized` has all of them."""
    settings = "CMAKE_BUILD_TYPE=Debug", "BPN_PORTABLE=ON"
    return built(tmp_path_factory.mktemp("sanitized"), *settings, flags=(*SANITIZED, "-O1", "-g1"))


def told(program: Path, *arguments: str | Path) -> list[str]:
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def test_the_program_has_the_paths_of_the_python_kernel(library: Path) -> None:
    assert tuple(told(library / "bpn-infer", "--paths")) == available_paths()


@pytest.mark.parametrize("path", BLOBS, ids=lambda path: path.name)
def test_every_layer_is_exact_on_every_path(library: Path, path: Path, tmp_path: Path) -> None:
    blob = WeightBlob.decode(path.read_bytes())
    answers = list(records(blob, answers_of(path)))
    (tmp_path / "observations").write_bytes(b"".join(image.tobytes() for image, _ in answers))
    for name in available_paths():
        lines = iter(
            told(library / "bpn-infer", path, tmp_path / "observations", "--trace", "--path", name)
        )
        for _, layers in answers:
            for o, tau in zip(layers, blob.thresholds, strict=False):
                bits = (o.reshape(-1, len(tau)) >= tau).reshape(-1)
                assert next(lines) == "".join("01"[int(bit)] for bit in bits), name
            outputs, _, best = next(lines).partition(" :")
            assert outputs.split() == [str(o) for o in layers[-1]]
            dims = np.split(layers[-1], np.cumsum(blob.spec.action_dims)[:-1])
            assert best.split() == [str(np.argmax(own)) for own in dims]
        assert next(lines, None) is None


def test_bad_input_is_one_line_and_status_2(library: Path, tmp_path: Path) -> None:
    short = tmp_path / "short"
    short.write_bytes(b"\0" * 63)
    smallest = VECTORS / "smallest.bpnw"
    for arguments, reason in (
        ([smallest, "--path", "mmx"], "this processor has no such path"),
        ([smallest, short], "it ends within an observation"),
        ([smallest, tmp_path / "none"], "cannot be read"),
        ([tmp_path / "none"], "cannot be read"),
        ([VECTORS / "refused/no-stride.bpnw"], "layer 1: d is 0, not 1 to 4"),
        ([], "bpn-infer BLOB"),
    ):
        done = subprocess.run(
            [library / "bpn-infer", *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.count("\n") == 1
        assert reason in done.stderr


def changed(rng: np.random.Generator, original: bytes) -> bytes:
    """One to four places of it changed, mostly in the header; mostly with the right digest."""
    data = bytearray(original)
    for _ in range(rng.integers(1, 5)):
        end = 128 if rng.random() < 0.7 else len(data) - 32
        at = int(rng.integers(4, min(end, len(data) - 32)))
        value = int(
            rng.choice([0, 1, 2, 3, 255, data[at] ^ 1 << int(rng.integers(8)), rng.integers(256)])
        )
        data[at] = value
    if rng.random() < 0.1:
        del data[int(rng.integers(len(data))) :]
    elif rng.random() < 0.9:
        data[-32:] = hashlib.sha256(data[:-32]).digest()
    return bytes(data)


def is_blob(data: bytes) -> bool:
    try:
        WeightBlob.decode(data)
    except BlobError:
        return False
    return True


def test_it_takes_what_the_decoder_takes_and_nothing_else(sanitized: Path, tmp_path: Path) -> None:
    assert told(sanitized / "bpn-infer", "--paths") == ["portable"]
    reader = linked(sanitized, SUPPORT / "kernel_reader.c", tmp_path / "reader", *SANITIZED)
    rng = np.random.default_rng(5)
    small = [path.read_bytes() for path in BLOBS if path.stat().st_size < 4096]
    whole = [path.read_bytes() for path in (*BLOBS, *REFUSED)]
    cut = [small[0][:size] for size in range(len(small[0]))]
    blobs = [*whole, *cut, *(changed(rng, small[index % len(small)]) for index in range(CHANGED))]
    stream = b"".join(struct.pack("<I", len(blob)) + blob for blob in blobs)
    done = subprocess.run([reader], input=stream, capture_output=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    lines = done.stdout.decode("ascii").splitlines()
    assert len(lines) == len(blobs)
    taken = 0
    for blob, reason in zip(blobs, lines, strict=True):
        assert (reason == "") == is_blob(blob), reason
        taken += reason == ""
    assert len(BLOBS) < taken < len(blobs) / 2


def test_no_memory_is_taken_after_loading_and_instances_run_at_the_same_time(
    library: Path, tmp_path: Path
) -> None:
    program = linked(library, SUPPORT / "kernel_threads.c", tmp_path / "threads", "-std=gnu11")
    for name in ("paper-tracking", "odd-channels"):
        assert told(program, VECTORS / f"{name}.bpnw", VECTORS / f"{name}.bin") == []
