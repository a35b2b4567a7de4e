"""An algorithm from another package, installed from a folder: it trains, is offered and verified as ours are."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from example_packages import install_examples, train_with, where_installed
from flags import flags
from pool import Pool, running_pool

from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.seeds import action_uniforms

Command = Callable[..., list[str]]
WaitFor = Callable[..., None]
LONG_S = 150.0
SMALL = {"iterations": 1, "episodes": 2, "steps": 6, "epochs": 1, "hidden_units": 8}
OPTIONS = '{"explore": 1.0}'


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the example is installed."""
    site = tmp_path_factory.mktemp("site")
    install_examples(site, "own_algorithm")
    return site


@pytest.fixture(scope="module")
def trained(
    site: Path, command: Command, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    words = ("reaching", "--algorithm", "hedged", "--algorithm-options", OPTIONS, *flags(SMALL))
    return train_with(where_installed(site), command, tmp_path_factory.mktemp("runs"), *words)


def test_its_specification_and_options_travel_by_value(trained: dict[str, Any]) -> None:
    """Here it is not installed, and its run can be read."""
    config = RunFolder.open(trained["runs_dir"], trained["run_id"]).config()
    assert (config.algorithm_spec.targets, config.policy) == ("hedged", "hedged")
    assert config.own_options == {"explore": 1.0, "hedge": 0.2}
    assert config.relative_targets


def test_its_selection_draws_the_actions(trained: dict[str, Any]) -> None:
    """All of them any action, in order of the episode's random numbers."""
    folder = RunFolder.open(trained["runs_dir"], trained["run_id"])
    task = folder.config().task_spec

    for path in sorted((folder.path / "episodes").iterdir()):
        episode = Episode.decode(path.read_bytes(), task)
        uniforms = action_uniforms(episode.meta.seed, episode.steps)
        assert episode.actions.tolist() == [int(u * task.actions) for u in uniforms]


def test_what_verify_cannot_compute_it_says(
    trained: dict[str, Any], command: Command, site: Path
) -> None:
    done = subprocess.run(
        command("verify", trained["run_id"], "--runs-dir", str(trained["runs_dir"])),
        env=where_installed(site),
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the targets 'hedged' are no part of this program" in done.stdout
    assert "the action selection 'hedged' is no part of this program" in done.stdout


def test_an_option_that_it_has_not_is_refused(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(site))
    for options, what in (
        ('{"tau": 1}', "tau = 1: unknown; one of: hedge, explore"),
        ('{"explore": 2}', "explore = 2: Input should be less than or equal to 1"),
        ("explore", "no JSON"),
        ("[1]", "must be a JSON object"),
    ):
        with pytest.raises(ConfigError, match=what):
            RunConfig.for_task("reaching", algorithm="hedged", algorithm_options=options)


def test_where_it_is_not_installed_that_is_said(trained: dict[str, Any], command: Command) -> None:
    for arguments, reason in (
        (("train", "--resume", trained["run_id"]), "targets 'hedged' is not installed here"),
        (("train", "reaching", "--algorithm", "hedged"), "algorithm 'hedged' is not installed here"),
    ):  # fmt: skip
        done = subprocess.run(
            command(*arguments, "--runs-dir", str(trained["runs_dir"])),
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert done.returncode == 2
        assert reason in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_neither_an_edge_nor_who_creates_runs_needs_torch(site: Path) -> None:
    said = (
        "import sys; from bpn_shared import plugins\n"
        "plugins.load(plugins.ALGORITHMS, 'hedged'); plugins.load(plugins.SELECTIONS, 'hedged')\n"
        "import bpn_edge.service; assert 'torch' not in sys.modules"
    )
    environment = where_installed(site)
    subprocess.run([sys.executable, "-c", said], env=environment, timeout=60, check=True)


@pytest.fixture(scope="module")
def pool(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    """`bpn up` where the example is installed."""
    environment = where_installed(site)
    with running_pool(tmp_path_factory.mktemp("pool"), environment=environment) as running:
        yield running


def test_a_dashboard_offers_it_and_workers_train_it_to_the_same_weights(
    pool: Pool, trained: dict[str, Any], wait_for: WaitFor
) -> None:
    """What the start dialog shows is asked for, as it does, and then started."""
    schema = pool.dashboard._call("GET", "/config-schema")
    assert "hedged" in schema["schema"]["properties"]["algorithm"]["enum"]
    offered = {algorithm["name"]: algorithm for algorithm in schema["algorithms"]}
    assert offered["hedged"]["options"] == {"explore": 0.1, "hedge": 0.2}
    config = {"task": "reaching", "algorithm": "hedged", "algorithm_options": OPTIONS}
    run_id = pool.dashboard.create_run(config | SMALL)["id"]
    wait_for(lambda: pool.state(run_id) in {"finished", "failed"}, "the run to end", LONG_S)
    assert pool.state(run_id) == "finished", pool.run(run_id)
    commanded = RunFolder.open(trained["runs_dir"], trained["run_id"])
    assert pool.sha256(run_id) == commanded.newest_weights().content_sha256()
