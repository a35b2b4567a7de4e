"""A float run through all parts: CVI by ONNX Runtime at the edge."""

import io
import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx.reference import ReferenceEvaluator
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from bpn.verify.verification import Verification
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.weights import decode_weights
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder

Train = Callable[..., dict[str, Any]]
OPTIONS = [
    "reaching", "--algorithm", "cvi", "--seed", "5", "--iterations", "3", "--episodes", "8",
    "--epochs", "2", "--hidden-units", "24", "--replay-iterations", "2",
]  # fmt: skip


@pytest.fixture(scope="module")
def cvi(train: Train) -> dict[str, Any]:
    return train(*OPTIONS)


def test_what_the_edge_computed_is_what_the_published_model_says(cvi: dict[str, Any]) -> None:
    assert cvi["state"] == "finished"
    folder = RunFolder.open(Path(cvi["runs_dir"]), cvi["run_id"])
    task = folder.config().task_spec
    for iteration in (0, 2):
        weights = decode_weights(folder.weights_path(iteration).read_bytes())
        assert isinstance(weights, FloatWeights)
        model = ReferenceEvaluator(onnx.load(io.BytesIO(weights.model)))
        episode = Episode.decode(folder.episode_path(iteration, 7).read_bytes(), task)
        assert episode.outputs.dtype == np.float32
        for frame, outputs in zip(episode.frames, episode.outputs, strict=False):
            (P,) = model.run(None, {"pixels": frame[None].astype(np.float32)})
            np.testing.assert_allclose(outputs, P[0], rtol=1e-3, atol=1e-3)
    newest = folder.newest_weights()
    assert newest.version == 3
    assert newest.content_sha256() == cvi["weights_sha256"]


def test_interrupted_and_resumed_it_ends_with_the_same_weights(
    cvi: dict[str, Any],
    train: Train,
    tmp_path: Path,
    wait_for: Callable[..., None],
    command: Callable[..., list[str]],
) -> None:
    process = subprocess.Popen(
        command("train", *OPTIONS, "--runs-dir", str(tmp_path)), stdout=subprocess.DEVNULL
    )
    wait_for(lambda: len(list(tmp_path.glob("*/episodes/000001-*.bpne"))) > 2, "iteration 1", 150)
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130
    (path,) = (path.parent for path in tmp_path.glob("*/config.json"))
    resumed = train("--resume", path.name, runs_dir=tmp_path)
    assert resumed["weights_sha256"] == cvi["weights_sha256"]
    assert resumed["returns"] == cvi["returns"]


@pytest.mark.parametrize("algorithm", ["dqn", "dpp", "bqn"])
def test_every_other_algorithm_goes_through_the_loop(train: Train, algorithm: str) -> None:
    run = train(
        "reaching", "--algorithm", algorithm, "--iterations", "2", "--episodes", "2", "--epochs", "1",
        "--tensorboard",
    )  # fmt: skip
    assert (run["state"], run["weights_version"]) == ("finished", 2)
    folder = RunFolder.open(Path(run["runs_dir"]), run["run_id"])
    assert Verification(folder).run().agrees
    events = EventAccumulator(str(folder.path / "tensorboard")).Reload()
    found = [point.value for point in events.Scalars("return_px")]
    assert found == pytest.approx([record["return_px"] for record in folder.metrics()], rel=1e-6)


def test_eval_plays_it(cvi: dict[str, Any], command: Callable[..., list[str]]) -> None:
    done = subprocess.run(
        command("eval", cvi["run_id"], "--runs-dir", cvi["runs_dir"], "--trials", "1", "--json"),
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert json.loads(done.stdout)["lengths"] == [20]


def test_a_kernel_of_the_other_kind_is_refused(
    cvi: dict[str, Any], command: Callable[..., list[str]]
) -> None:
    done = subprocess.run(
        command("eval", cvi["run_id"], "--runs-dir", cvi["runs_dir"], "--kernel", "native"),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "kernel = 'native' does not run the network of 'cvi'" in done.stderr
