"""`bpn verify` over real short runs of every algorithm, with non-default values: it agrees, and sees changes."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bpn.verify.findings import CHECKS
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.config import RunConfig
from bpn_shared.runs.folder import RunFolder

Command = Callable[..., list[str]]
Train = Callable[..., dict[str, Any]]

SMALL = [
    "--seed", "9", "--iterations", "3", "--episodes", "4", "--epochs", "3", "--nodes", "16",
    "--datasets", "2", "--batch", "12", "--beta", "2.5", "--gamma", "0.8", "--learning-rate", "0.004",
    "--learning-rate-final", "0.1", "--learning-rate-last", "0.3", "--reward-scale", "0.05",
]  # fmt: skip
RUNS = {
    "bpn": ["reaching", "--alpha", "0.6", "--scale-initial", "0.3"],
    "bqn": ["tracking", "--algorithm", "bqn", "--steps", "12", "--epsilon-initial", "0.7",
            "--epsilon-final", "0.3", "--mask-terminals", "true"],
    "cvi": ["tracking", "--algorithm", "cvi", "--steps", "12", "--alpha", "0.6"],
    "dqn": ["reaching", "--algorithm", "dqn", "--epsilon-initial", "0.7", "--engine", "plain"],
    "dpp": ["reaching", "--algorithm", "dpp", "--robots", "2"],
    "pan and tilt": ["pan_tilt", "--steps", "12", "--alpha", "0.6", "--engine", "plain"],
    "gym": ["gym:CartPole-v1", "--steps", "25", "--frame-skip", "2", "--alpha", "0.6"],
    "two learners": ["reaching", "--learners", "2", "--alpha", "0.6", "--robots", "2"],
    "two float learners": ["reaching", "--algorithm", "cvi", "--learners", "2", "--alpha", "0.6"],
}  # fmt: skip
NOT_JUDGED = {"dqn": {"gradients"}, "pan and tilt": {"gradients"}}  # by autograd in the first place


def verified(command: Command, folder: RunFolder, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit status and what it says."""
    done = subprocess.run(
        command("verify", str(folder.run), "--runs-dir", str(folder.path.parent), "--json", *options),
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    return done.returncode, json.loads(done.stdout)


def differing(told: dict[str, Any]) -> dict[str, Any]:
    return {n: c["differences"] for n, c in told["checks"].items() if c["verdict"] == "differs"}


def folder_of(run: dict[str, Any]) -> RunFolder:
    return RunFolder.open(Path(run["runs_dir"]), run["run_id"])


@pytest.fixture(scope="module")
def bpn(train: Train) -> RunFolder:
    return folder_of(train(*RUNS["bpn"], *SMALL))


@pytest.fixture
def copied(bpn: RunFolder, tmp_path: Path) -> RunFolder:
    """The run, to change something in it."""
    shutil.copytree(bpn.path, tmp_path / bpn.path.name)
    return RunFolder(tmp_path / bpn.path.name)


def test_the_values_are_not_the_defaults() -> None:
    """Or an option that does not arrive would not show."""
    names = [name for name in SMALL if name.startswith("--")]
    given = dict(zip(SMALL[::2], SMALL[1::2], strict=True))
    config = RunConfig.for_task("reaching")
    for name in names:
        assert given[name] != str(getattr(config, name.removeprefix("--").replace("-", "_")))


@pytest.mark.parametrize("name", RUNS)
def test_a_run_agrees_with_what_is_recomputed(name: str, train: Train, command: Command) -> None:
    folder = folder_of(train(*RUNS[name], *SMALL))
    status, told = verified(command, folder)
    assert differing(told) == {}
    assert (status, told["agrees"], told["iterations"]) == (0, True, 3)
    judged = {n for n, check in told["checks"].items() if check["compared"]}
    assert judged == set(CHECKS) - NOT_JUDGED.get(name, set())
    assert told["checks"]["actions"]["compared"] >= 3 * 4 * 4
    by_pixels = folder.config().task_spec.rewards == "pixels"
    assert any("rewards" in text for text in told["trusted"]) != by_pixels


def test_a_run_made_elsewhere_agrees_within_rounding(bpn: RunFolder, command: Command) -> None:
    status, told = verified(command, bpn, "--elsewhere")
    assert (status, differing(told)) == (0, {})
    assert any("rounding alone" in note for note in told["checks"]["weights"]["notes"])


def test_a_run_that_was_stopped_and_resumed_agrees(
    command: Command, train: Train, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    process = subprocess.Popen(
        command("train", *RUNS["bpn"], *SMALL, "--runs-dir", str(tmp_path)),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for(lambda: len(list(tmp_path.glob("*/episodes/000001-*.bpne"))) > 1, "iteration 1", 60)
    process.terminate()
    process.wait(30)
    (folder,) = (RunFolder(path.parent) for path in tmp_path.glob("*/config.json"))
    status, told = verified(command, folder)
    assert (status, differing(told)) == (0, {})
    assert told["iterations"] < 3
    train("--resume", str(folder.run), runs_dir=tmp_path)
    status, told = verified(command, folder)
    assert (status, differing(told), told["iterations"]) == (0, {}, 3)


def test_in_realtime_actions_are_those_that_were_applied(train: Train, command: Command) -> None:
    """With a delay longer than the control period, so that every action comes too late."""
    run = train(
        "reaching", "--pacing", "realtime", "--action-delay-ms", "160", "--iterations", "1",
        "--episodes", "2", "--epochs", "1", "--steps", "8", "--nodes", "16",
    )  # fmt: skip
    status, told = verified(command, folder_of(run))
    assert (status, differing(told)) == (0, {})


def other_weights(folder: RunFolder, version: int) -> None:
    """One sign of a version turned, as no training leaves it."""
    blob = folder.weights(version)
    assert isinstance(blob, WeightBlob)
    signs = [rows.copy() for rows in blob.weights]
    signs[3][0, 0] *= -1
    changed = WeightBlob(
        blob.spec, tuple(signs), blob.thresholds, blob.scale, blob.run, blob.attempt, blob.version
    )
    folder.weights_path(version).write_bytes(changed.encode())


def test_one_sign_is_seen(copied: RunFolder, command: Command) -> None:
    other_weights(copied, 2)
    status, told = verified(command, copied)
    assert status == 1
    found = differing(told)
    assert found["weights"][0]["where"] == "iteration 1"
    assert found["weights"][0]["found"].startswith("1 of ")
    assert set(found) >= {"weights", "digests"}


def test_another_beginning_is_seen(copied: RunFolder, command: Command) -> None:
    other_weights(copied, 0)
    found = differing(verified(command, copied)[1])
    assert found["initial weights"][0]["found"].startswith("1 of ")


def test_a_missing_episode_is_seen(copied: RunFolder, command: Command) -> None:
    copied.episode_path(1, 2).unlink()
    status, told = verified(command, copied)
    assert status == 1
    assert differing(told)["files"][0]["where"] == "iteration 1"


@pytest.mark.parametrize(
    ("key", "value", "check"),
    [
        ("return_px", -1.0, "returns"), ("length", 19.0, "returns"), ("transitions", 1, "returns"),
        ("epsilon", 0.5, "epsilon"), ("updates", 1, "updates"), ("max_target", 0.1, "targets"),
        ("max_preference", 0.1, "targets"), ("loss", 0.1, "losses"), ("loss_first", 0.1, "losses"),
        ("scale", 0.1, "scale"), ("saturation", 0.9, "scale"), ("weights_sha256", "0" * 64, "digests"),
    ],
)  # fmt: skip
def test_every_number_of_the_metrics_is_compared(
    key: str, value: object, check: str, copied: RunFolder, command: Command
) -> None:
    *_, last = copied.metrics()
    assert last[key] != value
    copied.append_metrics(last | {key: value})
    found = differing(verified(command, copied)[1])
    assert set(found) == {check}


def test_a_reward_is_compared(copied: RunFolder, command: Command) -> None:
    rewards = copied.rewards()[2]
    rewards[1][3] -= 0.01
    copied.append_rewards(2, rewards)
    found = differing(verified(command, copied)[1])
    assert set(found) == {"rewards"}
    assert found["rewards"][0]["where"] == "episode (2, 1), step 3"
    assert np.isclose(float(found["rewards"][0]["found"]), rewards[1][3])


def test_a_person_reads_one_line_for_each_check(bpn: RunFolder, command: Command) -> None:
    done = subprocess.run(
        command("verify", str(bpn.run), "--runs-dir", str(bpn.path.parent)),
        capture_output=True, text=True, timeout=100, check=True,
    )  # fmt: skip
    for name in CHECKS:
        assert f"\nok         {name} " in done.stdout
    assert "on trust   the frames" in done.stdout
    assert done.stdout.endswith("all agrees\n")


@pytest.mark.parametrize("run", ["nowhere", ""])
def test_what_cannot_be_verified_is_said(run: str, tmp_path: Path, command: Command) -> None:
    done = subprocess.run(
        command("verify", run, "--runs-dir", str(tmp_path)),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "no run in" in done.stderr
