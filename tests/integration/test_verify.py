"""`bpn verify` over real short runs of every algorithm, with non-default values: it agrees, and sees changes."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save

from bpn.verify.findings import CHECKS, Difference, Findings
from bpn.verify.verification import Verification, what_is_trusted
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

Command = Callable[..., list[str]]
Train = Callable[..., dict[str, Any]]

SMALL = [
    "--seed", "9", "--iterations", "3", "--episodes", "4", "--epochs", "3", "--hidden-units", "16",
    "--replay-iterations", "2", "--batch-size", "12", "--beta", "2.5", "--beta-run-final-factor", "3",
    "--gamma", "0.8",
    "--learning-rate", "0.004", "--lr-update-final-factor", "0.1", "--lr-run-final-factor", "0.3",
    "--reward-scale", "0.05",
]  # fmt: skip
RUNS = {
    "bpn": ["reaching", "--alpha", "0.6", "--scale-initial", "0.3"],
    "bqn": ["tracking", "--algorithm", "bqn", "--steps", "12", "--epsilon-initial", "0.7",
            "--epsilon-final", "0.3", "--bootstrap-terminals", "false"],
    "cvi": ["tracking", "--algorithm", "cvi", "--steps", "12", "--alpha", "0.6"],
    "dqn": ["reaching", "--algorithm", "dqn", "--epsilon-initial", "0.7", "--backend", "torch"],
    "dpp": ["reaching", "--algorithm", "dpp", "--robots", "2"],
    "pan and tilt": ["pan_tilt", "--steps", "12", "--alpha", "0.6", "--backend", "torch"],
    "gym": ["gym:CartPole-v1", "--steps", "25", "--frame-skip", "2", "--alpha", "0.6"],
    "units found out": ["reaching", "--alpha", "0.6", "--scale-initial", "0", "--reward-scale", "0",
                        "--n-step", "4"],
    "beyond the paper": ["tracking", "--steps", "12", "--alpha", "0.6", "--n-step", "3", "--gap-floor", "2",
                         "--max-updates", "7", "--replay-transitions", "60", "--bootstrap-terminals", "false",
                         "--disturb", "noise=0..25,offset=-30..30,jpeg=30..90,backlash=2",
                         "--augment", "gain=0.5..1.5,noise=9"],
    "factored": ["arm", "--alpha", "0.6", "--n-step", "2", "--gap-floor", "2", "--steps", "12"],
    "factored bqn": ["pan_tilt_both", "--algorithm", "bqn", "--steps", "12", "--epsilon-initial", "0.7",
                     "--epsilon-final", "0.3"],
    "two learners": ["reaching", "--learners", "2", "--alpha", "0.6", "--robots", "2"],
    "two float learners": ["reaching", "--algorithm", "cvi", "--learners", "2", "--alpha", "0.6"],
}  # fmt: skip
NOT_JUDGED = {"dqn": {"gradients"}, "pan and tilt": {"gradients"}}  # by autograd in the first place


def verified(folder: RunFolder, *, elsewhere: bool = False) -> Findings:
    return Verification(folder, elsewhere=elsewhere).run()


def differing(findings: Findings) -> dict[str, list[Difference]]:
    return {n: check.differences for n, check in findings.checks.items() if check.differences}


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
def test_a_run_agrees_with_what_is_recomputed(name: str, train: Train) -> None:
    task, *own = RUNS[name]
    findings = verified(folder_of(train(task, *SMALL, *own)))
    assert differing(findings) == {}
    judged = {n for n, check in findings.checks.items() if check.compared}
    assert judged == set(CHECKS) - NOT_JUDGED.get(name, set())
    assert findings["actions"].compared >= 3 * 4 * 4


@pytest.fixture(scope="module")
def warm(bpn: RunFolder, train: Train) -> RunFolder:
    """A run that begins with another one's weights, beside it."""
    return folder_of(
        train(
            *RUNS["bpn"],
            *SMALL,
            "--seed",
            "11",
            "--init-from",
            str(bpn.run),
            runs_dir=bpn.path.parent,
        )
    )


def test_a_run_that_begins_with_anothers_weights_agrees(warm: RunFolder) -> None:
    findings = verified(warm)
    assert differing(findings) == {}
    assert findings["initial weights"].compared == 4  # policy, other run, copy, version 0
    assert findings["initial weights"].notes == []
    assert "latent weights" in " ".join(what_is_trusted(warm.config()))
    assert differing(verified(warm, elsewhere=True)) == {}


def test_a_float_run_that_begins_with_anothers_weights_agrees(train: Train) -> None:
    first = folder_of(train(*RUNS["cvi"], *SMALL))
    second = train(*RUNS["cvi"], *SMALL, "--init-from", str(first.run), runs_dir=first.path.parent)
    assert differing(verified(folder_of(second))) == {}


def test_without_the_other_run_its_digest_tells_what_was_begun_with(
    warm: RunFolder, tmp_path: Path
) -> None:
    shutil.copytree(warm.path, tmp_path / warm.path.name)
    alone = RunFolder(tmp_path / warm.path.name)
    findings = verified(alone)
    assert differing(findings) == {}
    (note,) = findings["initial weights"].notes
    assert "its policy is known by its SHA-256" in note

    other_weights(alone, 0)
    where = [d.where for d in differing(verified(alone))["initial weights"]]
    assert where[0].startswith("SHA-256 of version 0, which is version 3 of run ")
    assert where[1:] == ["version 0"]


@pytest.mark.parametrize("change", ["altered", "cut", "gone", "another network"])
def test_another_copy_of_what_was_begun_with_is_seen(
    change: str, warm: RunFolder, tmp_path: Path
) -> None:
    shutil.copytree(warm.path, tmp_path / warm.path.name)
    folder = RunFolder(tmp_path / warm.path.name)
    copy = folder.path / "initial.safetensors"
    data = copy.read_bytes()
    if change == "altered":
        copy.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    elif change == "cut":
        copy.write_bytes(data[:-9])
    elif change == "gone":
        copy.unlink()
    else:
        copy.write_bytes(save({"network.latent": torch.zeros(3)}))
    assert "initial weights" in differing(verified(folder))


def test_a_run_made_elsewhere_agrees_within_rounding(bpn: RunFolder) -> None:
    findings = verified(bpn, elsewhere=True)
    assert differing(findings) == {}
    assert any("rounding alone" in note for note in findings["weights"].notes)


@pytest.mark.parametrize(
    "changes",
    [
        {"lr_update_final_factor": 1.0},
        {"learning_rate": 1e-3},
        {"epochs": 8},
        {"replay_iterations": 9},
    ],
)
def test_within_rounding_another_training_is_told_from_this(
    bpn: RunFolder, changes: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = bpn.config().model_copy(update=changes)
    monkeypatch.setattr(RunFolder, "config", lambda _: asked)
    assert not verified(bpn, elsewhere=True).agrees


def test_a_run_that_was_stopped_and_resumed_agrees(
    command: Command, train: Train, tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    process = subprocess.Popen(
        command("train", *RUNS["bpn"], *SMALL, "--runs-dir", str(tmp_path)),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait_for(lambda: len(list(tmp_path.glob("*/episodes/000001-*.bpne"))) > 1, "iteration 1", 150)
    process.terminate()
    process.wait(30)
    (folder,) = (RunFolder(path.parent) for path in tmp_path.glob("*/config.json"))
    assert differing(verified(folder)) == {}
    assert len(folder.metrics()) < 3
    train("--resume", str(folder.run), runs_dir=tmp_path)
    assert differing(verified(folder)) == {}
    assert len(folder.metrics()) == 3


def test_in_realtime_actions_are_those_that_were_applied(train: Train) -> None:
    """With a delay longer than the control period, so that every action answers an older frame."""
    run = train(
        "reaching", "--pacing", "realtime", "--action-delay-ms", "160", "--iterations", "1",
        "--episodes", "2", "--epochs", "1", "--steps", "8", "--hidden-units", "16",
    )  # fmt: skip
    findings = verified(folder_of(run))
    assert differing(findings) == {}
    assert findings["actions"].compared == 16


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


def test_one_sign_is_seen(copied: RunFolder) -> None:
    other_weights(copied, 2)
    found = differing(verified(copied))
    assert found["weights"][0].where == "iteration 1"
    assert found["weights"][0].found.startswith("1 of ")
    assert set(found) >= {"weights", "digests"}


def test_another_beginning_is_seen(copied: RunFolder) -> None:
    other_weights(copied, 0)
    found = differing(verified(copied))
    assert found["initial weights"][0].found.startswith("1 of ")


def test_a_missing_episode_is_seen(copied: RunFolder) -> None:
    copied.episode_path(1, 2).unlink()
    assert differing(verified(copied))["files"][0].where == "iteration 1"


CHANGED: dict[str, dict[str, object]] = {
    "returns": {"return_px": -1.0, "length": 19.0, "transitions": 1, "terminated": 1, "successes": 4,
                "deadline_misses": 1},
    "epsilon": {"epsilon": 0.5},
    "updates": {"updates": 1},
    "targets": {"max_target": 0.1, "max_preference": 0.1},
    "losses": {"loss": 0.1, "loss_first": 0.1},
    "scale": {"scale": 0.1, "saturation": 0.9},
    "digests": {"weights_sha256": "0" * 64, "weights_version": 2},
}  # fmt: skip


def test_every_number_of_the_metrics_is_compared(copied: RunFolder) -> None:
    *_, last = copied.metrics()
    changed = {key: value for values in CHANGED.values() for key, value in values.items()}
    assert all(last[key] != value for key, value in changed.items())
    copied.append_metrics(last | changed)
    found = {name: [d.found for d in of] for name, of in differing(verified(copied)).items()}
    assert found.keys() == CHANGED.keys()
    for name, values in CHANGED.items():
        expected = [f"{v:.7g}" if isinstance(v, float) else str(v) for v in values.values()]
        assert sorted(found[name]) == sorted(expected)


def test_a_reward_is_compared(copied: RunFolder) -> None:
    rewards = copied.rewards()[2]
    rewards[1][3] -= 0.01
    copied.append_rewards(2, rewards)
    found = differing(verified(copied))
    assert set(found) == {"rewards"}
    assert found["rewards"][0].where == "episode (2, 1), step 3"
    assert float(found["rewards"][0].found) == pytest.approx(rewards[1][3])


def test_a_script_reads_one_object(copied: RunFolder, command: Command) -> None:
    *_, last = copied.metrics()
    copied.append_metrics(last | {"loss": 0.1})
    done = subprocess.run(
        command("verify", str(copied.run), "--runs-dir", str(copied.path.parent), "--json"),
        capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    told = json.loads(done.stdout)
    assert (told["agrees"], told["iterations"], set(told["checks"])) == (False, 3, set(CHECKS))
    (difference,) = told["checks"]["losses"]["differences"]
    assert difference["where"] == "iteration 2, loss"
    assert difference["found"] == "0.1"


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
