"""A Gymnasium environment through all parts: its rewards and its ends are what is learned from."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder

Command = Callable[..., list[str]]
OPTIONS = [
    "gym:CartPole-v1", "--iterations", "2", "--episodes", "6", "--epochs", "1", "--hidden-units", "16",
    "--frame-skip", "2", "--steps", "12",
]  # fmt: skip


@pytest.fixture(scope="module")
def cartpole(train: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    return train(*OPTIONS)


def test_rewards_travel_with_the_frames_and_are_the_return(cartpole: dict[str, Any]) -> None:
    folder = RunFolder.open(Path(cartpole["runs_dir"]), cartpole["run_id"])
    config = folder.config()
    assert (config.actions, config.frame_skip, config.bootstrap_terminals) == (2, 2, False)
    for record in folder.metrics():
        episodes = [
            Episode.decode(
                folder.episode_path(record["iteration"], e).read_bytes(), config.task_spec
            )
            for e in range(6)
        ]
        for episode in episodes:
            assert set(episode.rewards[:-1]) <= {2.0}  # one for each of two steps
            assert episode.rewards[-1] in (1.0, 2.0)  # the pole may fall after the first
            assert episode.meta.terminated or episode.steps == 12
        assert record["returns"] == pytest.approx([e.rewards.sum() for e in episodes])
        assert record["terminated"] == sum(episode.meta.terminated for episode in episodes)
        assert "return_px" not in record
        assert "successes" not in record  # CartPole does not say what success is
    assert cartpole["returns"] == [
        pytest.approx(np.mean(record["returns"]), abs=1e-3) for record in folder.metrics()
    ]


def test_eval_reports_it_without_pixels(cartpole: dict[str, Any], command: Command) -> None:
    done = subprocess.run(
        command(
            "eval", cartpole["run_id"], "--runs-dir", cartpole["runs_dir"], "--trials", "2",
            "--policy", "random", "--json",
        ),
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    result = json.loads(done.stdout)
    assert all(value > 2 for value in result["returns"])
    assert "tracking_time" not in result
    assert "return_px" not in result
    assert (result["success_share"], result["successes"]) == (None, [None, None])
    assert result["terminated"] == sum(length < 12 for length in result["lengths"])


def test_eval_prints_no_success_where_nobody_defines_it(
    cartpole: dict[str, Any], command: Command
) -> None:
    done = subprocess.run(
        command("eval", cartpole["run_id"], "--runs-dir", cartpole["runs_dir"], "--trials", "1"),
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("success"))
    assert line.split() == ["success", "n/a"]


def test_what_cannot_be_a_task_is_said_before_anything_starts(
    tmp_path: Path, command: Command
) -> None:
    done = subprocess.run(
        command("train", "gym:Pendulum-v1", "--action-bins", "1"),
        capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 2
    assert "has 1 actions, a policy has 2..64" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_plot_that_nobody_can_draw_is_refused_before_anything_is_played(
    cartpole: dict[str, Any], command: Command, tmp_path: Path
) -> None:
    done = subprocess.run(
        command(
            "eval", cartpole["run_id"], "--runs-dir", cartpole["runs_dir"],
            "--plot", str(tmp_path / "a.png"), "--video", str(tmp_path / "b.gif"),
        ),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "no trajectories are known of task 'gym:CartPole-v1'" in done.stderr
    assert not list(tmp_path.iterdir())
