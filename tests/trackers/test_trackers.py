"""The callbacks that write to Weights & Biases and MLflow, with the real libraries and no network."""

import json
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mlflow import MlflowClient
from mlflow.exceptions import MlflowException
from wandb.proto.wandb_internal_pb2 import Record

from bpn_learner.callbacks import Callback, RunEnd, UpdateEnd
from bpn_learner.callbacks.mlflow import MLflow
from bpn_learner.callbacks.wandb import WeightsAndBiases
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig

RUN = "01a21e2b-4a1d-7550-8c36-dce4819c20af"
CONFIG = RunConfig.for_task("reaching", seed=4)
NOBODY = "http://127.0.0.1:9"


class Run:
    """What a callback needs to know of a run."""

    config, records = CONFIG, ()

    def __init__(self, folder: Path, first: int) -> None:
        self.folder, self.first = folder, first


def record(iteration: int, value: float) -> dict[str, object]:
    return {
        "iteration": iteration, "time_unix_s": 1.7e9 + iteration, "return_px": value,
        "returns_px": [1.0, 2.0], "weights_sha256": "00",
    }  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    (tmp_path / RUN).mkdir()
    return tmp_path / RUN


def attempt(
    kind: type[Callback], folder: Path, first: int, values: list[float], *, reason: str = ""
) -> Callback:
    callback = kind(Run(folder, first))  # type: ignore[arg-type]
    for iteration, value in enumerate(values, first):
        callback.on_update_end(UpdateEnd(iteration, record(iteration, value), None))  # type: ignore[arg-type]
    callback.on_run_end(RunEnd(finished=True, reason=reason))
    return callback


def chunks(data: bytes) -> Iterator[bytes]:
    """The records of W&B's file, which is a log as LevelDB's: blocks of 32 KiB, which cut records in parts."""
    at, whole = 7, b""
    while at + 7 <= len(data):
        if (left := 2**15 - at % 2**15) < 7:
            at += left
            continue
        length, part = struct.unpack_from("<HB", data, at + 4)  # after a checksum
        whole += data[at + 7 : at + 7 + length]
        at += 7 + length
        if part in (1, 4):  # all of it, or its last part
            yield whole
            whole = b""


def records(folder: Path) -> list[Record]:
    """What W&B has kept for later, attempt by attempt."""
    found = []
    paths = folder.glob("wandb/offline-run-*/*.wandb")
    for path in sorted(paths, key=lambda path: path.stat().st_mtime_ns):
        for chunk in chunks(path.read_bytes()):
            found.append(Record())
            found[-1].ParseFromString(chunk)
    return found


def history(folder: Path, name: str) -> list[tuple[int, float]]:
    """Step and value of a metric, as they would be synced."""
    return [
        (found.history.step.num, json.loads(item.value_json))
        for found in records(folder)
        for item in found.history.item
        if name in (item.key, *item.nested_key)
    ]


def test_weights_and_biases_gets_every_number_and_the_configuration(
    folder: Path, wait_for: Callable[..., None]
) -> None:
    attempt(WeightsAndBiases, folder, 0, [-3.0, -2.0], reason="good enough")
    wait_for(
        lambda: any(found.HasField("exit") for found in records(folder)),
        "W&B's process to have written all",
    )
    assert history(folder, "return_px") == [(0, -3.0), (1, -2.0)]
    assert history(folder, "returns_px") == history(folder, "weights_sha256") == []
    (run,) = [found.run for found in records(folder) if found.HasField("run")]
    assert (run.run_id, run.project, run.display_name) == (RUN, "bpn", "reaching 819c20af")
    told = {item.key: json.loads(item.value_json) for item in run.config.update}
    assert {name: told[name] for name in ("task", "seed")} == {"task": "reaching", "seed": 4}
    ends = [i for f in records(folder) for i in f.summary.update if "ended_early" in str(i)]
    assert json.loads(ends[-1].value_json) == "good enough"


def test_weights_and_biases_goes_on_with_the_same_run(
    folder: Path, wait_for: Callable[..., None]
) -> None:
    attempt(WeightsAndBiases, folder, 0, [1.0, 2.0])
    begun_s = int(time.time())
    wait_for(lambda: int(time.time()) > begun_s, "the next second, by which W&B names its folders")
    attempt(WeightsAndBiases, folder, 2, [3.0])
    told = [(0, 1.0), (1, 2.0), (2, 3.0)]
    wait_for(lambda: history(folder, "return_px") == told, "W&B's process to have written all")
    assert {found.run.run_id for found in records(folder) if found.HasField("run")} == {RUN}


def mlflow_run() -> Any:
    client = MlflowClient()
    experiment = client.get_experiment_by_name("bpn")
    assert experiment is not None
    (run,) = client.search_runs([experiment.experiment_id])
    return run


def points(name: str) -> list[tuple[int, float, int]]:
    found = MlflowClient().get_metric_history(mlflow_run().info.run_id, name)
    return [(point.step, point.value, point.timestamp) for point in found]


def test_mlflow_gets_every_number_and_the_configuration(folder: Path) -> None:
    attempt(MLflow, folder, 0, [-3.0, -2.0], reason="good enough")
    assert points("return_px") == [(0, -3.0, 1_700_000_000_000), (1, -2.0, 1_700_000_001_000)]
    run = mlflow_run()
    assert run.data.metrics.keys() == {"iteration", "time_unix_s", "return_px"}
    assert (run.data.params["task"], run.data.params["seed"]) == ("reaching", "4")
    assert (run.info.status, run.data.tags["bpn.ended_early"]) == ("FINISHED", "good enough")


def test_mlflow_goes_on_with_the_same_run(folder: Path) -> None:
    attempt(MLflow, folder, 0, [1.0, 2.0])
    attempt(MLflow, folder, 2, [3.0])
    assert [value for _, value, _ in points("return_px")] == [1.0, 2.0, 3.0]


def test_what_mlflow_misses_it_gets_later(folder: Path) -> None:
    """As when its server is away for a while: here it does not know the run."""
    callback = MLflow(Run(folder, 0))  # type: ignore[arg-type]
    known = callback._run_id
    for iteration, run_id in enumerate([known, "0" * 32, "0" * 32, known]):
        callback._run_id = run_id
        end = UpdateEnd(iteration, record(iteration, float(iteration)), None)  # type: ignore[arg-type]
        if run_id == known:
            callback.on_update_end(end)
        else:
            with pytest.raises(MlflowException, match="not found"):
                callback.on_update_end(end)
    assert [(step, value) for step, value, _ in points("return_px")] == [
        (0, 0.0), (1, 1.0), (2, 2.0), (3, 3.0),
    ]  # fmt: skip


@pytest.mark.parametrize("uri", [NOBODY, "nothing://x"])
def test_a_place_of_mlflow_that_is_none_is_said_before_the_training(
    uri: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with pytest.raises(ConfigError, match=r"callback 'mlflow': .*MLFLOW_TRACKING_URI") as refused:
        MLflow(Run(folder, 0))  # type: ignore[arg-type]
    assert len(str(refused.value).splitlines()) == 1


def train(place: Path, *options: str, **variables: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "bpn", "train", "reaching", "--iterations", "2", "--episodes", "1",
         "--epochs", "1", "--hidden-units", "16", "--json", "--runs-dir", str(place / "runs"), *options],
        env=os.environ | {"HOME": str(place)} | variables,
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip


def test_weights_and_biases_without_a_key_fails_the_run_with_the_remedy(tmp_path: Path) -> None:
    done = train(tmp_path, "--callbacks", "wandb")
    assert done.returncode != 0
    assert "callback 'wandb': UsageError: No API key configured" in done.stderr
    assert "WANDB_MODE=offline" in done.stderr


def test_both_are_written_by_a_run_and_change_no_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uri = f"sqlite:///{tmp_path}/mlflow.db"
    digests = []
    for options in ([], ["--callbacks", "wandb,mlflow"]):
        done = train(tmp_path, *options, WANDB_MODE="offline", MLFLOW_TRACKING_URI=uri)
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        digests.append(told["weights_sha256"])
    assert digests[0] == digests[1]
    folder = RunFolder.open(tmp_path / "runs", told["run_id"])
    measured = [record["return_px"] for record in folder.metrics()]
    assert [value for _, value in history(folder.path, "return_px")] == measured
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    assert [value for _, value, _ in points("return_px")] == measured
    log = (folder.logs / "learner.log").read_text()
    assert "callback mlflow" in log.partition("MLflow: run ")[2]  # it takes no logging away
