"""`bpn up` as its users have it: runs are started in the dashboard, workers take them, anything may die."""

import argparse
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pool import Pool, running_pool

from bpn.dashboard import Dashboard
from bpn.options import add_run_options
from bpn_learner.factory import has_gpu
from bpn_shared.errors import InputError

LONG_S = 150.0
Train = Callable[..., dict[str, Any]]
WaitFor = Callable[..., None]


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pool]:
    runs_dir = tmp_path_factory.mktemp("pool")
    with running_pool(runs_dir, "--learners", "2", "--first-run", "reaching") as running:
        yield running


@pytest.fixture(scope="module")
def config(small: list[str]) -> dict[str, Any]:
    """The small run as the dashboard takes it."""
    parser = argparse.ArgumentParser()
    add_run_options(parser, small)
    given = {key: value for key, value in vars(parser.parse_args(small)).items() if value}
    return {"task": "reaching"} | {key: int(value) for key, value in given.items()}


def test_there_is_a_first_run_and_it_can_be_stopped(pool: Pool, wait_for: WaitFor) -> None:
    runs: list[dict[str, Any]] = []

    def first_run() -> bool:
        runs[:] = pool.dashboard._call("GET", "/runs")["items"]
        return bool(runs) and runs[0]["state"] == "running"

    wait_for(first_run, "the first run", LONG_S)
    (run,) = runs
    assert (run["task"], run["config"]["iterations"]) == ("reaching", 50)
    wait_for(lambda: pool.folder(run["id"]).episode_path(0, 0).exists(), "an episode", LONG_S)
    pool.dashboard.stop(run["id"])
    wait_for(lambda: pool.state(run["id"]) == "stopped", "the run to stop", LONG_S)
    assert pool.folder(run["id"]).state().state == "stopped"


def test_two_learners_share_a_sweep_and_one_may_die(
    pool: Pool, config: dict[str, Any], undisturbed: dict[str, Any], wait_for: WaitFor
) -> None:
    seeds = [5, 3, 4, 6, 7, 8]
    sweep = pool.dashboard._call(
        "POST", "/sweeps", json={"name": "seeds", "config": config, "grid": {}, "seeds": seeds}
    )
    runs = {pool.dashboard.run(run_id)["seed"]: run_id for run_id in sweep["run_ids"]}
    assert sorted(runs) == sorted(seeds)
    first = runs[5]
    wait_for(lambda: pool.folder(first).episode_path(1, 3).exists(), "the middle", LONG_S)
    states = [pool.state(run_id) for run_id in runs.values()]
    assert states.count("running") == 2  # two learners, two robots with their edges
    victim = pool.learner(first)
    assert victim in pool.services("bpn_learner")
    victim.kill()

    def states_of_all() -> dict[str, int]:
        found: dict[str, int] = pool.dashboard._call("GET", f"/sweeps/{sweep['id']}")["states"]
        return found

    wait_for(lambda: states_of_all() == {"finished": 6}, "all six runs", 2 * LONG_S)
    attempts = {seed: pool.folder(run_id).state().attempt for seed, run_id in runs.items()}
    assert attempts == {5: 2} | dict.fromkeys(seeds[1:], 1)
    assert pool.sha256(first) == undisturbed["weights_sha256"]
    for run_id in runs.values():
        assert len(pool.folder(run_id).metrics()) == config["iterations"]
        names = {path.name for path in pool.folder(run_id).logs.iterdir()}
        assert names == {"learner.log", "edge-0.log", "robot_sim-0.log"}


def test_two_learners_share_a_run_and_either_may_die(
    pool: Pool, config: dict[str, Any], small: list[str], train: Train, wait_for: WaitFor
) -> None:
    alone = train("reaching", "--seed", "5", *small, "--learners", "2", "--epochs", "10")
    shared = config | {"seed": 5, "learners": 2, "epochs": 10}
    run_id = pool.dashboard.create_run(shared)["id"]
    folder = pool.folder(run_id)
    for iteration, rank in ((1, 1), (2, 0)):
        wait_for(folder.episode_path(iteration, 3).exists, f"iteration {iteration}", LONG_S)
        pool.learner(run_id, rank).kill()
    wait_for(lambda: pool.state(run_id) == "finished", "the run's end", LONG_S)
    assert pool.sha256(run_id) == alone["weights_sha256"]
    assert folder.state().attempt == 2  # the second learner's death ended no attempt
    assert (folder.logs / "learner-1.log").exists()


def test_the_dashboard_may_die_in_the_middle_of_a_run(
    pool: Pool, config: dict[str, Any], undisturbed: dict[str, Any], wait_for: WaitFor
) -> None:
    run_id = pool.dashboard.create_run(config | {"seed": 5})["id"]
    wait_for(lambda: pool.folder(run_id).episode_path(1, 3).exists(), "the middle", LONG_S)
    (victim,) = pool.services("bpn_dashboard")
    victim.kill()
    wait_for(lambda: pool.services("bpn_dashboard") not in ([], [victim]), "another one", LONG_S)

    def back() -> bool:
        found = Dashboard.find(pool.runs_dir)
        if found is not None:
            assert found.url == pool.dashboard.url  # pages that are open find it again
            pool.dashboard = found
        return found is not None

    wait_for(back, "the dashboard to answer again", LONG_S)
    wait_for(lambda: pool.state(run_id) == "finished", "the run's end", LONG_S)
    run = pool.dashboard.run(run_id)
    assert (run["attempt"], run["iteration"]) == (1, 4)
    assert pool.sha256(run_id) == undisturbed["weights_sha256"]

    def points() -> list[float]:
        query = {"runs": [run_id], "metrics": ["return_px"], "x": "iteration"}
        series = pool.dashboard._call("POST", "/series/query", json=query)["series"]
        return [value for one in series for value in one["value"]]

    wait_for(lambda: len(points()) == 4, "a curve without a gap")
    assert points() == pytest.approx(undisturbed["returns"], abs=1e-3)


def test_a_run_that_was_stopped_and_resumed_ends_as_if_undisturbed(
    pool: Pool, config: dict[str, Any], undisturbed: dict[str, Any], wait_for: WaitFor
) -> None:
    run_id = pool.dashboard.create_run(config | {"seed": 5})["id"]
    wait_for(lambda: pool.folder(run_id).episode_path(2, 3).exists(), "iteration 2", LONG_S)
    pool.dashboard.stop(run_id)
    wait_for(lambda: pool.state(run_id) == "stopped", "the run to stop", LONG_S)
    assert pool.folder(run_id).state().state == "stopped"
    assert not pool.folder(run_id).is_owned()
    pool.dashboard.resume(run_id)
    wait_for(lambda: pool.state(run_id) == "finished", "the run's end", LONG_S)
    assert pool.dashboard.run(run_id)["attempt"] == 2
    assert pool.sha256(run_id) == undisturbed["weights_sha256"]


def test_train_goes_through_the_dashboard(
    pool: Pool, train: Train, small: list[str], undisturbed: dict[str, Any]
) -> None:
    result = train("reaching", "--seed", "5", *small, runs_dir=pool.runs_dir)
    assert result["weights_sha256"] == undisturbed["weights_sha256"]
    assert result["stderr"].count("iteration ") == 4  # one line each
    assert result.keys() == undisturbed.keys()
    assert pool.dashboard.run(result["run_id"])["state"] == "finished"


def test_a_run_for_a_gpu_is_taken_only_where_a_learner_has_one(
    pool: Pool, wait_for: WaitFor
) -> None:
    said: list[str] = []

    def refused() -> bool:
        try:
            made = pool.dashboard.create_run({"task": "reaching", "device": "cuda"})
        except InputError as error:
            said.append(str(error))
            return "at any of the 2 connected learners" in said[-1]
        pool.dashboard.stop(made["id"])
        return has_gpu()

    wait_for(refused, "both learners to have told whether they have a GPU", LONG_S)
    assert has_gpu() or "torch finds no GPU" in said[-1]


def test_ctrl_c_stops_a_run_that_goes_through_the_dashboard(
    pool: Pool, command: Callable[..., list[str]], wait_for: WaitFor
) -> None:
    before = set(pool.runs_dir.glob("*/config.json"))
    process = subprocess.Popen(
        command("train", "reaching", "--runs-dir", str(pool.runs_dir)),
        stdout=subprocess.PIPE,
        text=True,
    )
    new: set[Path] = set()

    def playing() -> bool:
        new.update(set(pool.runs_dir.glob("*/config.json")) - before)
        return any((path.parent / "episodes" / "000000-00002.bpne").exists() for path in new)

    wait_for(playing, "the run to begin", LONG_S)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=LONG_S)
    assert process.returncode == 130
    assert "bpn train --resume" in output
    (config_file,) = new
    assert pool.state(config_file.parent.name) == "stopped"


def test_workers_keep_nothing_of_the_runs_that_they_served(
    pool: Pool, config: dict[str, Any], wait_for: WaitFor
) -> None:
    tiny = config | {"iterations": 1, "episodes": 2, "epochs": 1}
    modules = ("bpn_learner", "bpn_robot_sim", "bpn_edge")

    def serve_some() -> dict[int, tuple[int, int]]:
        runs = [pool.dashboard.create_run(tiny)["id"] for _ in range(4)]
        for run_id in runs:
            wait_for(lambda r=run_id: pool.state(r) == "finished", "a tiny run", LONG_S)
        counts: dict[int, tuple[int, int]] = {}
        for module in modules:
            for worker in pool.services(module):
                counts[worker.pid] = worker.num_threads(), worker.num_fds()
        return counts

    serve_some()
    before = serve_some()
    after = serve_some()
    assert before.keys() == after.keys()
    for pid, (threads, files) in after.items():
        assert threads <= before[pid][0] + 8, "threads of a session that is being closed, at most"
        assert files <= before[pid][1] + 8


def test_a_second_dashboard_of_the_same_runs_is_refused(
    pool: Pool, command: Callable[..., list[str]]
) -> None:
    for arguments in (("up",), ("dashboard", "reindex")):
        done = subprocess.run(
            command(*arguments, "--runs-dir", str(pool.runs_dir)),
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert done.returncode == 2
        assert pool.dashboard.url in done.stderr
