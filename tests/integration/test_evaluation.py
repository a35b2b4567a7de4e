"""`bpn eval` with real processes: what is played, in both pacings, and what is written."""

import json
import os
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import psutil
import pytest

from bpn.evaluation.trials import TrialPlan, play
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.observation import stack
from bpn_shared.spec.seeds import action_uniforms

STEPS, HOLD, PERIOD_MS = 12, 3, 145
DELAY_MS = 2.76 * PERIOD_MS


@pytest.fixture(scope="module")
def tracking_run(train: Callable[..., dict[str, Any]]) -> RunFolder:
    run = train(
        "tracking", "--iterations", "1", "--episodes", "2", "--epochs", "1", "--hidden-units", "16",
        "--steps", str(STEPS), "--batch-size", "8",
    )  # fmt: skip
    return RunFolder.open(Path(run["runs_dir"]), run["run_id"])


def played(folder: RunFolder, count: int, policy: Any, **changes: Any) -> list[Episode]:
    trials = TrialPlan(count, policy, seed=3, changes=changes)
    return play(folder, folder.newest_weights(), trials, threading.Event())


@pytest.fixture(scope="module")
def greedy(tracking_run: RunFolder) -> list[Episode]:
    return played(tracking_run, 4, "greedy")


def equal(one: list[Episode], other: list[Episode]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a.frames, b.frames) and np.array_equal(a.actions, b.actions)
        for a, b in zip(one, other, strict=True)
    )


def test_greedy_trials_take_the_best_action_of_the_newest_weights(
    tracking_run: RunFolder, greedy: list[Episode]
) -> None:
    weights = tracking_run.newest_weights()
    assert isinstance(weights, WeightBlob)
    assert [episode.meta.episode for episode in greedy] == [0, 1, 2, 3]
    for episode in greedy:
        assert episode.meta.weights_version == 1
        for step in range(episode.steps):
            expected = golden.forward(weights, stack(episode.frames, step, 2))[-1]
            np.testing.assert_array_equal(episode.outputs[step], expected)
            assert episode.actions[step] == np.argmax(expected)


def test_random_trials_ignore_the_network(tracking_run: RunFolder) -> None:
    for episode in played(tracking_run, 2, "random"):
        uniforms = action_uniforms(episode.meta.seed, episode.steps).tolist()
        assert episode.actions.tolist() == [int(uniform * 7) for uniform in uniforms]


def test_several_robots_and_a_killed_edge_play_the_same_trials(
    tracking_run: RunFolder, wait_for: Callable[..., None]
) -> None:
    undisturbed = played(tracking_run, 24, "softmax")
    two: list[Episode] = []
    player = threading.Thread(
        target=lambda: two.extend(played(tracking_run, 24, "softmax", robots=2))
    )

    def edges() -> list[psutil.Process]:
        children = psutil.Process().children(recursive=True)
        return [child for child in children if "bpn_edge" in " ".join(child.cmdline())]

    player.start()
    wait_for(lambda: len(edges()) == 2, "two edges", 150)
    edges()[0].kill()
    player.join(120)
    assert equal(two, undisturbed)


def test_a_delayed_action_acts_that_much_later_and_the_robot_holds_until_the_first(
    tracking_run: RunFolder,
) -> None:
    (episode,) = played(
        tracking_run, 1, "random", pacing="realtime", action_delay_ms=DELAY_MS, steps=8
    )
    assert episode.actions[:2].tolist() == [HOLD, HOLD]
    acted = episode.camera_to_action_ns > 0
    assert acted[2:].any()
    assert not acted[:2].any()
    assert (episode.camera_to_action_ns[acted] >= DELAY_MS * 1e6).all()
    assert (~acted).sum() == episode.meta.deadline_misses
    chosen = iter((action_uniforms(episode.meta.seed, episode.steps) * 7).astype(int).tolist())
    assert all(action in chosen for action in episode.actions[acted].tolist())  # in their order


def test_the_command_reports_films_and_draws(
    tracking_run: RunFolder,
    greedy: list[Episode],
    tmp_path: Path,
    command: Callable[..., list[str]],
) -> None:
    film, figure = tmp_path / "film.mp4", tmp_path / "paths.png"
    done = subprocess.run(
        command(
            "eval", str(tracking_run.run), "--runs-dir", str(tracking_run.path.parent), "--trials", "4",
            "--seed", "3", "--video", str(film), "--plot", str(figure), "--json",
        ),
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    result = json.loads(done.stdout)
    assert result["lengths"] == [episode.steps for episode in greedy]
    assert result["successes"] == [not episode.meta.terminated for episode in greedy]
    assert result["tracking_time"]["steps"] == pytest.approx(np.mean(result["lengths"]), abs=0.01)
    assert (result["policy"], result["pacing"], result["seed"]) == ("greedy", "lockstep", 3)
    assert len(imageio.imread(film)) == sum(result["lengths"]) + 4
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--video", "film.avi"], "--video film.avi: the name must end with one of .mp4, .gif"),
        (["--plot", "paths"], "--plot paths: the name must end with one of .png"),
        (
            ["--plot", "/nonexist/x.png"],
            "--plot /nonexist/x.png: there is no folder /nonexist; make it",
        ),
        (
            ["--video", "/nonexist/x.mp4"],
            "--video /nonexist/x.mp4: there is no folder /nonexist; make it",
        ),
        (["--trials", "0"], "trials = 0 must be at least 1"),
        (["--action-delay-ms", "4"], "action_delay_ms = 4.0 means nothing in lockstep"),
        (["--version", "7"], "version = 7: not in"),
    ],
)
def test_wrong_input_is_refused_before_anything_is_played(
    arguments: list[str], message: str, tracking_run: RunFolder, command: Callable[..., list[str]]
) -> None:
    done = subprocess.run(
        command("eval", str(tracking_run.run), "--runs-dir", str(tracking_run.path.parent), *arguments),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_result_survives_that_its_film_cannot_be_written(
    tracking_run: RunFolder, command: Callable[..., list[str]], tmp_path: Path
) -> None:
    film = tmp_path / "film.gif"
    film.symlink_to("/dev/full")
    done = subprocess.run(
        command(
            "eval", str(tracking_run.run), "--runs-dir", str(tracking_run.path.parent),
            "--trials", "1", "--video", str(film), "--json",
        ),
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert json.loads(done.stdout)["trials"] == 1
    assert done.stderr.splitlines()[-1].startswith(f"bpn: --video {film} could not be written: ")
    assert "Traceback" not in done.stderr


def test_a_result_is_told_to_a_terminal_of_ascii(
    tracking_run: RunFolder, command: Callable[..., list[str]]
) -> None:
    done = subprocess.run(
        command("eval", str(tracking_run.run), "--runs-dir", str(tracking_run.path.parent), "--trials", "2"),
        capture_output=True, text=True, timeout=120, check=True,
        env=os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    )  # fmt: skip
    assert done.stdout.isascii()
    assert " +- " in done.stdout
