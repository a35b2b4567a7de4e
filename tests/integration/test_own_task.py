"""A task from another package, installed from a folder: it trains, and is checked and offered as ours are."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from example_packages import install_examples, train_with, where_installed
from pool import Pool, running_pool

from bpn.testing import check_task
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.installed import offered, task_spec
from bpn_shared.spec.tasks import TaskOptions

Command = Callable[..., list[str]]
WaitFor = Callable[..., None]
LONG_S = 150.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the example is installed."""
    site = tmp_path_factory.mktemp("site")
    install_examples(site, "own_task")
    return site


@pytest.fixture(scope="module")
def trained(
    site: Path, command: Command, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    words = ("centre", "--iterations", "1", "--episodes", "2", "--epochs", "1")
    return train_with(where_installed(site), command, tmp_path_factory.mktemp("runs"), *words)


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
        env=where_installed(site),
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


@pytest.fixture(scope="module")
def pool(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    """`bpn up` where the example is installed."""
    environment = where_installed(site)
    with running_pool(tmp_path_factory.mktemp("pool"), environment=environment) as running:
        yield running


def test_a_dashboard_offers_it_and_workers_train_it_to_the_same_weights(
    pool: Pool, trained: dict[str, Any], wait_for: WaitFor
) -> None:
    """What the start dialog shows is asked for, as it does, and then started with other values."""
    presets = pool.dashboard._call("GET", "/config-schema")["presets"]
    assert presets["centre"]["steps"] == 15
    assert {"centre", "reaching", "gym:"} <= presets.keys()
    run = pool.dashboard.create_run({"task": "centre", "iterations": 1, "episodes": 2, "epochs": 1})
    run_id = run["id"]
    wait_for(lambda: pool.state(run_id) in {"finished", "failed"}, "the run to end", LONG_S)
    assert pool.state(run_id) == "finished", pool.run(run_id)
    assert pool.folder(run_id).config().task_spec.title == "Dot to the centre"
    commanded = RunFolder.open(trained["runs_dir"], trained["run_id"])
    assert pool.sha256(run_id) == commanded.newest_weights().content_sha256()


def test_it_passes_the_check(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(site))
    check_task(task_spec("centre", TaskOptions()))


def test_it_is_offered_beside_ours(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(site))
    tasks = offered()
    assert {"centre", "reaching"} <= {spec.name for spec in tasks.specs}
    assert tasks.presets["centre"]["hidden_units"] == 64
