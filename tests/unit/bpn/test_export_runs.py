"""Exports of runs: tables and a film by their readers, a LeRobot dataset field by field against its layout."""

import json
import resource
import signal
from collections.abc import Iterator
from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
import pandas
import pyarrow.parquet
import pytest
from played import CONFIG, episode

import bpn
from bpn.cli import main
from bpn.export.lerobot import CAMERA
from bpn.run import Run
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.errors import InputError
from bpn_shared.runs.folder import RunFolder

STEPS = [3, 2, 4]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Two iterations; the first has two episodes."""
    from uuid import UUID

    folder = RunFolder.create(tmp_path / "runs", UUID(int=7), CONFIG)
    for iteration, index, steps in ((0, 0, STEPS[0]), (0, 1, STEPS[1]), (1, 0, STEPS[2])):
        stored = episode(iteration, index, steps=steps, terminated=index == 1)
        folder.write(f"episodes/{iteration:06d}-{index:05d}.bpne", stored.encode())
    for iteration in (0, 1):
        folder.append_metrics({"iteration": iteration, "loss": 0.5, "returns_px": [1.0, 2.0]})
    blob = WeightBlob.random(CONFIG.task_spec.network(1), np.random.default_rng(1))
    folder.write("weights/000000.bpnw", blob.encode())
    return bpn.open_run(folder.path)


def test_csv_has_the_metrics_that_are_numbers(run: Run, tmp_path: Path) -> None:
    run.export("csv", tmp_path / "m.csv")
    table = pandas.read_csv(tmp_path / "m.csv")
    assert table.to_dict("list") == {"iteration": [0, 1], "loss": [0.5, 0.5]}


def test_metrics_of_some_iterations_alone_are_in_the_tables(run: Run, tmp_path: Path) -> None:
    run.folder.append_metrics({"iteration": 2, "loss": 0.25, "eval_return": -3.0})
    run.export("csv", tmp_path / "m.csv")
    table = pandas.read_csv(tmp_path / "m.csv")
    assert table["eval_return"].isna().tolist() == [True, True, False]
    assert table["eval_return"][2] == -3.0


def test_parquet_has_every_step(run: Run, tmp_path: Path) -> None:
    metrics, steps = run.export("parquet", tmp_path / "tables")
    assert pandas.read_parquet(metrics)["iteration"].tolist() == [0, 1]
    table = pandas.read_parquet(steps)
    assert len(table) == sum(STEPS)
    expected = list(run.episodes())
    np.testing.assert_array_equal(table["reward"], np.concatenate([e.rewards for e in expected]))
    np.testing.assert_array_equal(table["action"], np.concatenate([e.actions for e in expected]))
    assert table["terminated"].tolist() == [False] * 4 + [True] + [False] * 4
    assert table["camera_to_action_us"].isna().all()


def test_the_film_is_of_the_newest_iteration(run: Run, tmp_path: Path) -> None:
    (path,) = run.export("mp4", tmp_path / "f.mp4")
    assert len(imageio.imread(path)) == STEPS[2] + 1


def test_the_lerobot_dataset_has_its_documented_layout(run: Run, tmp_path: Path) -> None:
    root = tmp_path / "set"
    run.export("lerobot", root)
    info = json.loads((root / "meta/info.json").read_text())
    assert {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()} == {
        "data/chunk-000/file-000.parquet",
        "meta/bpn.json",
        "meta/episodes/chunk-000/file-000.parquet",
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
    }
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, 9, 1)
    assert info["splits"] == {"train": "0:3"}
    assert info["fps"] == pytest.approx(1 / CONFIG.task_spec.control_period_s)
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"

    data = pyarrow.parquet.read_table(root / "data/chunk-000/file-000.parquet")
    kinds = {"image": "struct<bytes: binary, path: string>", "float32": "float"}
    assert {field.name: str(field.type) for field in data.schema} == {
        name: kinds.get(feature["dtype"], feature["dtype"])
        for name, feature in info["features"].items()
    }
    frames = data.to_pandas()
    expected = list(run.episodes())
    assert frames["index"].tolist() == list(range(9))
    assert frames["episode_index"].tolist() == [0] * 3 + [1] * 2 + [2] * 4
    assert frames["frame_index"].tolist() == [0, 1, 2, 0, 1, 0, 1, 2, 3]
    assert frames["task_index"].tolist() == [0] * 9
    np.testing.assert_allclose(frames["timestamp"] * info["fps"], frames["frame_index"], rtol=1e-6)
    assert frames["next.done"].tolist() == [step == n - 1 for n in STEPS for step in range(n)]
    rewards = np.concatenate([one.rewards for one in expected])
    np.testing.assert_allclose(frames["next.reward"], rewards, rtol=1e-6)
    assert frames["action"].tolist() == [a for one in expected for a in one.actions.tolist()]
    pictures = np.concatenate([one.frames[:-1] for one in expected])
    for cell, picture in zip(frames[CAMERA], pictures, strict=True):
        read = cv2.imdecode(np.frombuffer(cell["bytes"], np.uint8), cv2.IMREAD_UNCHANGED)
        assert read.shape == tuple(info["features"][CAMERA]["shape"])
        np.testing.assert_array_equal(read, np.repeat(picture.transpose(1, 2, 0), 3, axis=2))

    episodes = pandas.read_parquet(root / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["length"].tolist() == STEPS
    assert episodes["dataset_from_index"].tolist() == [0, 3, 5]
    assert episodes["dataset_to_index"].tolist() == [3, 5, 9]
    for name in ("data", "meta/episodes"):
        for which in ("chunk", "file"):
            assert episodes[f"{name}/{which}_index"].tolist() == [0, 0, 0]
    tasks = pandas.read_parquet(root / "meta/tasks.parquet")
    assert tasks["task_index"].tolist() == [0]
    assert [list(one) for one in episodes["tasks"]] == [[tasks.index[0]]] * 3


def test_its_statistics_are_those_of_all_frames(run: Run, tmp_path: Path) -> None:
    root = tmp_path / "set"
    run.export("lerobot", root)
    stats = json.loads((root / "meta/stats.json").read_text())
    assert set(stats) == set(json.loads((root / "meta/info.json").read_text())["features"])
    expected = list(run.episodes())
    rewards = np.concatenate([one.rewards for one in expected]).astype(np.float32)
    pixels = np.concatenate([one.frames[:-1] for one in expected]) / 255
    for name, values, shape in (("next.reward", rewards, (1,)), (CAMERA, pixels, (3, 1, 1))):
        for what, of in (("min", np.min), ("max", np.max), ("mean", np.mean), ("std", np.std)):
            np.testing.assert_allclose(stats[name][what], np.full(shape, of(values)), rtol=1e-5)
        assert stats[name]["count"] == [9]


def test_large_datasets_are_several_files(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bpn.export.lerobot._FILE_BYTES", 1)
    root = tmp_path / "set"
    run.export("lerobot", root)
    files = sorted(path.name for path in root.glob("data/*/*"))
    assert files == ["file-000.parquet", "file-001.parquet", "file-002.parquet"]
    episodes = pandas.read_parquet(root / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["data/file_index"].tolist() == [0, 1, 2]


def test_nothing_is_written_over_a_folder(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is there already"):
        run.export("lerobot", tmp_path)


def test_an_unknown_format_and_a_wrong_name_are_said(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown; one of: onnx, qonnx, c"):
        run.export("zip")
    with pytest.raises(InputError, match=r"must end with one of \.c"):
        run.export("c", tmp_path / "policy.h")


@pytest.mark.parametrize("form", ["onnx", "qonnx", "c", "csv", "parquet", "lerobot", "mp4"])
def test_the_command_writes_every_format_and_names_the_files(
    run: Run, form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(run.path), "--format", form, "--json"]) == 0
    files = json.loads(capsys.readouterr().out)
    assert files
    assert all(Path(name).stat().st_size > 0 for name in files)


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file may grow beyond 10 bytes, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("form", ["lerobot", "parquet", "csv", "c"])
def test_what_fails_halfway_leaves_all_as_it_was(
    run: Run,
    tmp_path: Path,
    form: str,
    small_files: None,  # noqa: ARG001  (after the run is written)
) -> None:
    output = tmp_path / "here"
    output.mkdir()
    older = output / f"older.{form}"
    if form in ("csv", "c"):
        older.write_bytes(b"of before")
    with pytest.raises(OSError, match=r"File too large|No space"):
        run.export(form, older)
    assert [path.read_bytes() for path in output.iterdir()] == [b"of before"] * older.exists()
