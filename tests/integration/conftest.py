import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

# Small, but through every part: 4 iterations so that D holds old and new data.
OPTIONS = [
    "--iterations",
    "4",
    "--episodes",
    "12",
    "--epochs",
    "2",
    "--nodes",
    "24",
    "--datasets",
    "2",
]


def command_line(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "bpn", *arguments]


@pytest.fixture(scope="session")
def command() -> Callable[..., list[str]]:
    """The `bpn` command with these arguments."""
    return command_line


@pytest.fixture(scope="session")
def small() -> list[str]:
    """Options of a run that takes seconds."""
    return OPTIONS


@pytest.fixture(scope="session")
def train(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., dict[str, Any]]:
    """`bpn train --json` as a user would call it; returns the final object."""

    def run(*arguments: str, runs_dir: Path | None = None) -> dict[str, Any]:
        runs_dir = runs_dir or tmp_path_factory.mktemp("runs")
        done = subprocess.run(
            command_line("train", *arguments, "--json", "--runs-dir", str(runs_dir)),
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        result: dict[str, Any] = json.loads(done.stdout)
        return result | {"runs_dir": str(runs_dir), "stderr": done.stderr}

    return run


@pytest.fixture(scope="session")
def undisturbed(train: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """The run that all others with the same seed must equal."""
    return train("reaching", "--seed", "5", *OPTIONS)
