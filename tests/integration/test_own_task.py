"""A task from another package, installed from a folder: it trains, and is checked and offered as ours are."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.installed import offered

Command = Callable[..., list[str]]
EXAMPLE = Path(__file__).parents[2] / "examples/own_task"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the example is installed."""
    site, source = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("source") / "own_task"
    shutil.copytree(EXAMPLE, source)  # a build leaves things behind
    subprocess.run(
        [
            sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps",
            "--no-build-isolation", "--target", site, source,
        ],
        check=True, timeout=120,
    )  # fmt: skip
    return site


@pytest.fixture(scope="module")
def trained(
    site: Path, command: Command, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    runs_dir = tmp_path_factory.mktemp("runs")
    done = subprocess.run(
        command(
            "train", "centre", "--iterations", "1", "--episodes", "2", "--epochs", "1", "--json",
            "--runs-dir", str(runs_dir),
        ),
        env=os.environ | {"PYTHONPATH": str(site)},
        stdout=subprocess.PIPE, text=True, timeout=120, check=True,
    )  # fmt: skip
    return json.loads(done.stdout) | {"runs_dir": runs_dir}


def test_it_trains_with_its_robot_and_its_rewards(trained: dict[str, Any]) -> None:
    config = RunFolder.open(trained["runs_dir"], trained["run_id"]).config()
    assert (config.task_spec.robot, config.steps, config.actions) == ("dot", 15, 5)
    assert trained["transitions"] == 30
    assert -900 < trained["returns"][0] < 0


def test_its_run_verifies_where_it_is_installed(
    trained: dict[str, Any], command: Command, site: Path
) -> None:
    done = subprocess.run(
        command("verify", trained["run_id"], "--runs-dir", str(trained["runs_dir"])),
        env=os.environ | {"PYTHONPATH": str(site)},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_where_it_is_not_installed_that_is_said(trained: dict[str, Any], command: Command) -> None:
    """The run's folder can be read; nobody there can play it, or start another."""
    runs_dir = str(trained["runs_dir"])
    for arguments, reason in (
        (("eval", trained["run_id"], "--trials", "1"), "robot 'dot' is not installed here"),
        (("train", "centre"), "task = 'centre': unknown; one of: "),
    ):
        done = subprocess.run(
            command(*arguments, "--runs-dir", runs_dir),
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert done.returncode == 2
        assert reason in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_it_is_offered_beside_ours(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(site))
    tasks = offered()
    assert {"centre", "reaching"} <= {spec.name for spec in tasks.specs}
    assert tasks.presets["centre"]["nodes"] == 64
