"""The edge's kernel as its library for C, built by its own CMake, and C programs on top of it."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "services/edge/src"
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror")


def built(folder: Path, *settings: str, flags: Sequence[str] = ()) -> Path:
    """A folder with libbpn_kernel.a and bpn-infer; CMake's settings are "NAME=value"."""
    beside = Path(os.sys.executable).parent
    cmake = shutil.which("cmake", path=f"{beside}:{os.environ['PATH']}")
    assert cmake is not None, "the kernels were compiled here, so there is CMake"
    told = [*settings, f"CMAKE_CXX_FLAGS={' '.join(flags)}", f"CMAKE_C_FLAGS={' '.join(flags)}"]
    for command in (
        [cmake, "-S", SOURCES, "-B", folder, *(f"-D{setting}" for setting in told)],
        [cmake, "--build", folder, "--parallel", "2"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning:" not in done.stdout + done.stderr, done.stdout + done.stderr
    return folder


def linked(library: Path, source: Path, program: Path, *flags: str) -> Path:
    """A C program with the library in it."""
    archive = library / "libbpn_kernel.a"
    subprocess.run(
        ["cc", *STRICT, *flags, f"-I{SOURCES}", source, archive, "-lstdc++", "-lm", "-pthread", "-o", program],
        check=True,
    )  # fmt: skip
    return program
