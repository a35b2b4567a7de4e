"""The example in one file: the same weights, bit by bit, as the plain engine with all its services."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bpn_shared.runs.folder import RunFolder

PROGRAM = Path(__file__).parents[2] / "examples" / "bpn_single_file.py"
SMALL = [
    "--iterations",
    "3",
    "--episodes",
    "3",
    "--epochs",
    "2",
    "--hidden-units",
    "24",
    "--replay-iterations",
    "2",
]


@pytest.mark.parametrize("task", ["reaching", "tracking"])
def test_it_learns_the_plain_engines_weights(
    task: str, train: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    train(task, *SMALL, "--seed", "4", "--backend", "torch", runs_dir=tmp_path)
    (path,) = (path.parent for path in tmp_path.glob("*/config.json"))
    expected = [record["weights_sha256"] for record in RunFolder(path).metrics()]
    done = subprocess.run(
        [sys.executable, PROGRAM, "--task", task, "--seed", "4", *SMALL],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    assert [line.split()[-1] for line in done.stdout.splitlines()] == expected
