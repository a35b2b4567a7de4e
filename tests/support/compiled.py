"""Exported C, compiled and run: on this machine, or for another one in an emulator."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob

STRICT = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2"]
DRIVER = Path(__file__).with_name("c_driver.c")


def compiled(source: str, folder: Path, compiler: Sequence[str] = ("cc",)) -> Path:
    """A program of the exported policy and the driver; no warning is allowed, in the policy alone neither."""
    policy, program = folder / "policy.c", folder / "policy"
    policy.write_text(source)
    subprocess.run([*compiler, *STRICT, "-c", policy, "-o", folder / "policy.o"], check=True)
    both = folder / "both.c"
    both.write_text(f"#define BPN_TRACE\n{source}\n{DRIVER.read_text()}")
    subprocess.run([*compiler, *STRICT, both, "-o", program], check=True)
    return program


def ran(
    program: Path, observations: Sequence[np.ndarray], emulator: Sequence[str] = ()
) -> np.ndarray:
    """int32[observations, sums and best choices]."""
    pixels = b"".join(observation.tobytes() for observation in observations)
    done = subprocess.run(
        [*emulator, program], input=pixels, capture_output=True, check=True, timeout=120
    )
    return np.frombuffer(done.stdout, "<i4").reshape(len(observations), -1)


def expected(blob: WeightBlob, observation: np.ndarray) -> np.ndarray:
    """What it has to write: the golden model's sums, and the first of the best choices of each dimension."""
    sums = golden.forward(blob, observation)
    dims = np.split(sums[-1], np.cumsum(blob.spec.action_dims)[:-1])
    return np.concatenate([*(o.reshape(-1) for o in sums), [np.argmax(own) for own in dims]])
