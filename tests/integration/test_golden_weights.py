"""Runs come to the bits that they had before: begun by programs of before, or by the same command."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from golden_bits import is_like

from bpn_shared.runs.folder import RunFolder

Train = Callable[..., dict[str, Any]]
GOLDEN = Path(__file__).parents[1] / "golden"
OLD = sorted(path.parent for path in GOLDEN.glob("0.1.0/*/expected.json"))
TABLE = json.loads((GOLDEN / "weights.json").read_text())
ALL = [(task, name) for task, of in TABLE["weights_sha256"].items() for name in of]
SOME = [("reaching", "bpn"), ("tracking", "cvi"), ("pan_tilt", "dpp")]
"""Beside the old runs, which are of other pairs; with BPN_ALL_WEIGHTS all (`make test-weights`)."""


@pytest.mark.parametrize("old", OLD, ids=lambda path: path.name)
def test_a_run_of_version_0_1_0_goes_on_to_the_weights_that_it_had_then(
    old: Path, tmp_path: Path, train: Train
) -> None:
    (golden,) = (path for path in old.iterdir() if path.is_dir())
    expected = json.loads((old / "expected.json").read_text())
    folder = RunFolder(tmp_path / golden.name)
    shutil.copytree(golden, folder.path)
    before = folder.metrics()
    assert len(before) == expected["iterations"]
    summary = train("--resume", golden.name, runs_dir=tmp_path)
    assert (summary["state"], summary["iterations"], summary["episodes_lost"]) == ("finished", 6, 0)
    assert folder.metrics()[: len(before)] == before
    same = summary["weights_sha256"] == expected["weights_sha256"]
    assert same or not is_like(expected["made_by"])


@pytest.mark.parametrize(("task", "algorithm"), ALL if os.environ.get("BPN_ALL_WEIGHTS") else SOME)
def test_a_command_makes_the_weights_that_it_always_made(
    task: str, algorithm: str, train: Train
) -> None:
    summary = train(task, "--algorithm", algorithm, *TABLE["options"].split())
    same = summary["weights_sha256"] == TABLE["weights_sha256"][task][algorithm]
    assert same or not is_like(TABLE["made_by"])
