import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import torch

from bpn_learner.checkpoint import decode_checkpoint
from bpn_learner.networks import BinaryNetwork
from bpn_learner.update import make_optimizer
from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder

Train = Callable[..., dict[str, Any]]
Command = Callable[..., list[str]]
STEPS = 20


def test_the_summary_accounts_for_everything(undisturbed: dict[str, Any]) -> None:
    run = undisturbed
    assert run["state"] == "finished"
    assert (run["iterations"], run["episodes"], run["transitions"]) == (4, 48, 48 * STEPS)
    assert (run["episodes_lost"], run["episodes_duplicated"]) == (0, 0)
    assert run["weights_version"] == 4
    assert len(run["returns"]) == len(run["lengths"]) == 4
    folder = RunFolder.open(Path(run["runs_dir"]), run["run_id"])
    told = [record["return_px"] for record in folder.metrics()]
    assert run["returns"] == pytest.approx(told, abs=5e-4)  # which a person reads
    assert run["lengths"] == [STEPS] * 4
    assert 0 < run["edge"]["inference_us"]["p50"] <= run["edge"]["inference_us"]["p99"]
    loop = run["loop"]
    assert run["edge"]["inference_us"]["p50"] < loop["camera_to_action_us"]["p50"]
    assert loop["camera_to_action_us"]["p50"] <= loop["camera_to_action_us"]["p99"]
    assert loop["steps_per_s"] > 0
    assert run["learner"]["updates_per_s"] > 0
    assert run["stderr"].count("iteration ") == 4  # one line each


def test_the_run_folder_holds_what_the_run_did(undisturbed: dict[str, Any]) -> None:
    folder = RunFolder.open(Path(undisturbed["runs_dir"]), undisturbed["run_id"])
    assert len(list((folder.path / "weights").glob("*.bpnw"))) == 5
    assert folder.newest_weights().content_sha256() == undisturbed["weights_sha256"]
    task = folder.config().task_spec
    for record in folder.metrics():
        for index in range(12):
            path = folder.episode_path(record["iteration"], index)
            episode = Episode.decode(path.read_bytes(), task)
            assert episode.meta.weights_version == record["iteration"]
            assert episode.steps == STEPS


def test_every_recorded_output_is_what_the_golden_model_says(undisturbed: dict[str, Any]) -> None:
    folder = RunFolder.open(Path(undisturbed["runs_dir"]), undisturbed["run_id"])
    task = folder.config().task_spec
    for iteration in (0, 3):
        blob = WeightBlob.decode(folder.weights_path(iteration).read_bytes())
        for index in (0, 11):
            data = folder.episode_path(iteration, index).read_bytes()
            episode = Episode.decode(data, task)
            for frame, outputs in zip(episode.frames, episode.outputs, strict=False):
                np.testing.assert_array_equal(golden.forward(blob, frame)[-1], outputs)


def test_after_training_the_folded_blob_is_the_evaluated_network(
    undisturbed: dict[str, Any],
) -> None:
    folder = RunFolder.open(Path(undisturbed["runs_dir"]), undisturbed["run_id"])
    config = folder.config()
    network = BinaryNetwork(
        config.network, scale_initial=config.scale_initial, generator=torch.Generator()
    )
    optimizer = make_optimizer(network, config.learning_rate)
    assert decode_checkpoint(folder.checkpoint_path.read_bytes(), network, optimizer) == 4
    network.eval()
    blob = folder.newest_weights()
    frames = np.concatenate(
        [
            Episode.decode(path.read_bytes(), config.task_spec).frames
            for path in sorted((folder.path / "episodes").glob("*.bpne"))[-24:]  # D, U = 2
        ]
    )
    unique = np.unique(frames, axis=0)
    assert len(unique) > 50
    with torch.no_grad():
        evaluated = network(torch.from_numpy(unique).float()) / network.scale()
    folded = np.stack([golden.forward(blob, frame)[-1] for frame in unique])
    np.testing.assert_array_equal(evaluated.round().numpy().astype(np.int32), folded)


def test_two_robots_give_the_same_weights(
    undisturbed: dict[str, Any], train: Train, small: list[str]
) -> None:
    two = train("reaching", "--seed", "5", "--robots", "2", *small)
    assert two["weights_sha256"] == undisturbed["weights_sha256"]
    assert two["returns"] == undisturbed["returns"]
    folder = RunFolder.open(Path(two["runs_dir"]), two["run_id"])
    slots = {
        Episode.decode(path.read_bytes(), folder.config().task_spec).meta.slot
        for path in (folder.path / "episodes").glob("*.bpne")
    }
    assert slots == {0, 1}  # or the test would show nothing


def test_the_golden_kernel_gives_the_same_weights(
    undisturbed: dict[str, Any], train: Train, small: list[str]
) -> None:
    assert (
        train("reaching", "--seed", "5", "--kernel", "golden", *small)["weights_sha256"]
        == undisturbed["weights_sha256"]
    )


def test_another_seed_gives_other_weights(
    undisturbed: dict[str, Any], train: Train, small: list[str]
) -> None:
    assert (
        train("reaching", "--seed", "6", *small)["weights_sha256"] != undisturbed["weights_sha256"]
    )


def test_ctrl_c_stops_everything_and_resume_ends_as_if_undisturbed(
    undisturbed: dict[str, Any],
    train: Train,
    tmp_path: Path,
    wait_for: Callable[..., None],
    command: Command,
    small: list[str],
) -> None:
    process = subprocess.Popen(
        command("train", "reaching", "--seed", "5", *small, "--runs-dir", str(tmp_path)),
        stdout=subprocess.PIPE,
        text=True,
    )
    wait_for(lambda: len(list(tmp_path.glob("*/episodes/000002-*.bpne"))) > 3, "iteration 2", 150)
    services = psutil.Process(process.pid).children(recursive=True)
    assert len(services) == 4
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "bpn train --resume" in output
    assert not [service for service in services if service.is_running()]

    (folder,) = (RunFolder(path.parent) for path in tmp_path.glob("*/config.json"))
    assert folder.state().state == "stopped"
    resumed = train("--resume", str(folder.run), runs_dir=tmp_path)
    assert resumed["weights_sha256"] == undisturbed["weights_sha256"]
    assert resumed["returns"] == undisturbed["returns"]
    assert (resumed["episodes_lost"], resumed["episodes_duplicated"]) == (0, 0)
    assert folder.state().attempt == 2


def test_ctrl_c_as_soon_as_the_run_has_a_name_says_how_to_go_on(
    tmp_path: Path, command: Command
) -> None:
    process = subprocess.Popen(
        command("train", "reaching", "--json", "--runs-dir", str(tmp_path)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert process.stderr.readline().startswith("run ")
    process.send_signal(signal.SIGINT)
    output, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "stopped; go on with: bpn train --resume" in said
    assert json.loads(output)["state"] == "stopped"


def test_a_damaged_checkpoint_fails_once_and_names_the_remedy(
    train: Train, tmp_path: Path, command: Command
) -> None:
    train("reaching", "--iterations", "1", "--episodes", "2", "--epochs", "1", runs_dir=tmp_path)
    (folder,) = (RunFolder(path.parent) for path in tmp_path.glob("*/config.json"))
    folder.checkpoint_path.write_bytes(folder.checkpoint_path.read_bytes()[:100])
    done = subprocess.run(
        command("train", "--resume", str(folder.run), "--runs-dir", str(tmp_path)),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "cannot be resumed from" in done.stderr
    assert "remove checkpoint.safetensors to train the run from its beginning" in done.stderr
    assert folder.state().state == "failed"
    assert folder.state().attempt == 2  # a restart would not mend it, and none was tried


def test_a_realtime_robot_keeps_its_period(train: Train) -> None:
    run = train(
        "reaching", "--pacing", "realtime", "--iterations", "1", "--episodes", "2", "--epochs", "1"
    )
    folder = RunFolder.open(Path(run["runs_dir"]), run["run_id"])
    for index in range(2):
        data = folder.episode_path(0, index).read_bytes()
        episode = Episode.decode(data, folder.config().task_spec)
        period_s = folder.config().task_spec.control_period_s
        assert episode.meta.duration_ns / 1e9 > 0.98 * STEPS * period_s
        missed = episode.camera_to_action_ns == 0
        assert missed.sum() == episode.meta.deadline_misses
        hold = folder.config().task_spec.hold_action
        assert (episode.actions[missed] == hold).all()


@pytest.mark.parametrize("policy", ["greedy", "softmax"])
def test_eval_plays_the_runs_policy(
    undisturbed: dict[str, Any], policy: str, command: Command
) -> None:
    done = subprocess.run(
        command(
            "eval", undisturbed["run_id"], "--runs-dir", undisturbed["runs_dir"], "--trials", "2",
            "--policy", policy, "--json",
        ),
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    result = json.loads(done.stdout)
    assert result["weights_version"] == 4
    assert result["lengths"] == [STEPS, STEPS]
    assert all(-1500 < value < 0 for value in result["returns_px"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "flying"], "task = 'flying': unknown; one of: arm, gym:"),
        (
            ["train", "reaching", "--alpha", "2"],
            "alpha = '2': Input should be less than or equal to 1",
        ),
        (
            ["train", "reaching", "--device", "tpu"],
            "device = 'tpu': Input should be 'cpu' or 'cuda'",
        ),
        (["train"], "TASK is missing"),
        (["train", "--resume", "nowhere"], "no run in"),
        (["train", "reaching", "--resume", "x", "--seed", "1"], "leave out TASK, --seed"),
        (["eval", "nowhere"], "no run in"),
    ],
)
def test_wrong_input_names_the_value_and_the_remedy(
    arguments: list[str], message: str, tmp_path: Path, command: Command
) -> None:
    done = subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
