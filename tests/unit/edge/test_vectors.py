"""The published vectors are what the reference makes of them, and so do kernels and the example in C."""

import importlib.util
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from vectors import BLOBS, VECTORS, answers_of, records

from bpn_edge.kernel.native import NativeKernel, available_paths
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.envelope import BlobError

ROOT = Path(__file__).parents[3]
REFUSED = sorted(VECTORS.glob("refused/*.bpnw"))
KERNELS = [NativeKernel(path) for path in available_paths()]
KERNELS += [NativeKernel(any_shape=True)]
STRICT = ["-std=c99", "-O1", "-Wall", "-Wextra", "-pedantic", "-Werror"]
SANITIZED = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def made() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make", VECTORS / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_program_beside_them_writes_these_files_and_no_others() -> None:
    expected = dict(made().files())
    found = [*BLOBS, *REFUSED, *VECTORS.glob("*.bin"), VECTORS / "weights_sha256"]
    assert {str(path.relative_to(VECTORS)) for path in found} == expected.keys()
    for name, data in expected.items():
        assert (VECTORS / name).read_bytes() == data, name


@pytest.mark.parametrize("path", BLOBS, ids=lambda path: path.name)
def test_reference_and_native_kernels_give_the_answers(path: Path) -> None:
    blob = WeightBlob.decode(path.read_bytes())
    for kernel in KERNELS:
        kernel.load(blob)
    for image, layers in records(blob, answers_of(path)):
        for o, expected in zip(golden.forward(blob, image), layers, strict=True):
            np.testing.assert_array_equal(o.reshape(-1), expected)
        for kernel in KERNELS:
            activations, outputs = kernel.trace(image)
            np.testing.assert_array_equal(outputs, layers[-1])
            for bits, o, tau in zip(activations, layers, blob.thresholds, strict=False):
                np.testing.assert_array_equal(bits, (o.reshape(-1, len(tau)) >= tau).reshape(-1))


@pytest.mark.parametrize("path", REFUSED, ids=lambda path: path.stem)
def test_what_has_to_be_refused_is(path: Path) -> None:
    with pytest.raises(BlobError):
        WeightBlob.decode(path.read_bytes())


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example in C, with the sanitizers in it."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler is not None, "the kernels were compiled here, so there is a C compiler"
    program = tmp_path_factory.mktemp("c") / "bpn_blob"
    source = ROOT / "examples/weight_blob_c/bpn_blob.c"
    subprocess.run([compiler, *STRICT, *SANITIZED, str(source), "-o", str(program)], check=True)
    return program


def run(program: Path, *arguments: Path) -> tuple[int, str]:
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return done.returncode, done.stdout


@pytest.mark.parametrize("path", BLOBS, ids=lambda path: path.name)
def test_the_example_in_c_gives_the_answers(in_c: Path, path: Path) -> None:
    status, said = run(in_c, path, answers_of(path))
    assert (status, said.splitlines()[-1].partition(", ")[2]) == (0, "every layer is exact")


def test_the_example_in_c_notices_a_wrong_answer(in_c: Path, tmp_path: Path) -> None:
    data = bytearray((VECTORS / "smallest.bin").read_bytes())
    data[4 + 64] ^= 1  # the first sum of the first layer
    (tmp_path / "wrong.bin").write_bytes(data)
    status, said = run(in_c, VECTORS / "smallest.bpnw", tmp_path / "wrong.bin")
    assert (status, said.splitlines()[-1]) == (1, "record 0 differs in layer 1")


def test_the_example_in_c_refuses_what_has_to_be(in_c: Path, tmp_path: Path) -> None:
    for path in REFUSED:
        assert run(in_c, path)[0] == 2, path
    whole = (VECTORS / "smallest.bpnw").read_bytes()
    for size in (*range(64), 100, 128, 200, len(whole) - 32):  # nothing behind the end is read
        (tmp_path / "cut.bpnw").write_bytes(whole[:size])
        assert run(in_c, tmp_path / "cut.bpnw")[0] == 2, size
