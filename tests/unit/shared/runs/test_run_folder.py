import errno
import json
import shutil
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest

from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder, RunOwnedError, is_run_id, run_folders
from bpn_shared.spec.config import ConfigError, RunConfig

RUNS = [UUID(int=0x1234 << 112 | 1), UUID(int=0x1235 << 112 | 2)]


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder.create(tmp_path, RUNS[0], RunConfig.bare("reaching", seed=7))


def test_a_run_is_found_by_the_end_or_beginning_of_its_id(
    folder: RunFolder, tmp_path: Path
) -> None:
    RunFolder.create(tmp_path, RUNS[1], RunConfig.bare("reaching"))
    assert RunFolder.open(tmp_path, "1234").run == folder.run
    assert RunFolder.open(tmp_path, str(RUNS[1])).run == RUNS[1]
    with pytest.raises(ConfigError, match="2 runs in"):
        RunFolder.open(tmp_path, "123")
    with pytest.raises(ConfigError, match="no run in"):
        RunFolder.open(tmp_path, "nothing")


def test_the_configuration_is_kept(folder: RunFolder) -> None:
    assert folder.config() == RunConfig.bare("reaching", seed=7)
    (folder.path / "config.json").write_text('{"task": "reaching", "alpha": 2}')
    with pytest.raises(ConfigError, match=r"config\.json: alpha = 2: .*less than or equal to 1"):
        folder.config()


def test_lines_have_digests_since_schema_2(folder: RunFolder, tmp_path: Path) -> None:
    """A line without one is damage in a run of today, and all there is in one of schema 1."""
    (old,) = (Path(__file__).parents[3] / "golden" / "schema-1").iterdir()
    for _ in range(2):
        assert folder.has_sealed_lines() is True
        assert RunFolder(old).has_sealed_lines() is False
    missing = RunFolder(tmp_path / str(RUNS[1]))
    assert missing.has_sealed_lines() is True  # not there yet
    shutil.copytree(old, missing.path)
    assert missing.has_sealed_lines() is False


def test_a_run_that_is_seen_has_all_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowly(path: Path, data: bytes, *, root: Path, **_: object) -> None:
        for name in ("config.json", "state.json"):  # before each file, and after it
            for config in tmp_path.glob("*/config.json"):
                RunFolder(config.parent).state()
            if path.name == name:
                write_atomically(path, data, root=root)

    monkeypatch.setattr("bpn_shared.runs.folder.write_atomically", slowly)
    made = RunFolder.create(tmp_path, UUID(int=1), RunConfig.for_task("reaching"))
    assert made.state().state == "queued"
    assert made.config() == RunConfig.for_task("reaching")


def test_attempts_count_owners(folder: RunFolder) -> None:
    assert folder.state().attempt == 0
    assert folder.set_state("running", new_attempt=True).attempt == 1
    assert folder.set_state("stopped").attempt == 1
    assert folder.set_state("running", new_attempt=True).attempt == 2
    assert folder.state().created_unix_s <= folder.state().updated_unix_s


def test_a_line_cut_by_a_crash_is_left_out_and_the_later_record_counts(folder: RunFolder) -> None:
    folder.append_metrics({"iteration": 0, "return_px": -3.0})
    with (folder.path / "metrics.jsonl").open("a") as file:
        file.write('{"iteration": 1, "retu')
    folder.append_metrics({"iteration": 1, "return_px": -2.0})
    folder.append_metrics({"iteration": 1, "return_px": -1.0})
    assert [record["return_px"] for record in folder.metrics()] == [-3.0, -1.0]


def test_replacing_a_file_leaves_the_old_one_if_it_cannot_finish(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")
    with pytest.raises(TypeError):
        write_atomically(path, "not bytes")  # type: ignore[arg-type]
    assert path.read_bytes() == b"old"


def test_one_learner_owns_a_run(folder: RunFolder) -> None:
    assert not folder.is_owned()
    with folder.owned("learner-1"):
        assert folder.is_owned()
        with (
            pytest.raises(RunOwnedError, match="is being learned by learner-1: wait"),
            folder.owned("learner-2", patience_s=0.1),
        ):
            pass
        assert folder.is_owned()
    assert not folder.is_owned()
    with folder.owned("learner-2"):
        pass


def test_rewards_are_kept_by_iteration(folder: RunFolder) -> None:
    folder.append_rewards(0, [[-1.5, -2.0], [-3.0]])
    assert folder.rewards() == {0: [[-1.5, -2.0], [-3.0]]}
    line = json.loads((folder.path / "rewards.jsonl").read_text())
    assert (line["iteration"], line["rewards_px"]) == (0, [[-1.5, -2.0], [-3.0]])


@pytest.mark.parametrize("order", [("config.json", "state.json"), ("state.json", "config.json")])
def test_a_folder_that_is_copied_in_any_order_is_there_once_it_is_whole(
    folder: RunFolder, tmp_path: Path, order: tuple[str, str]
) -> None:
    copy = RunFolder(tmp_path / "runs" / folder.path.name)
    copy.path.mkdir(parents=True)
    for name in order:
        assert not copy.is_complete()
        assert list(run_folders(copy.path.parent)) == []
        (copy.path / name).write_bytes((folder.path / name).read_bytes())
    assert copy.is_complete()
    assert [found.path for found in run_folders(copy.path.parent)] == [copy.path]


def test_a_run_has_one_spelling_and_a_link_to_one_is_none(
    folder: RunFolder, tmp_path: Path
) -> None:
    name = folder.path.name
    for other in (
        name.upper().replace("1", "A", 1),
        name.replace("-", ""),
        f"{{{name}}}",
        "sweeps",
    ):
        shutil.copytree(folder.path, tmp_path / other, dirs_exist_ok=True)
        assert not RunFolder(tmp_path / other).is_complete()
        assert not is_run_id(other)
    (tmp_path / str(RUNS[1])).symlink_to(folder.path)
    assert [found.path for found in run_folders(tmp_path)] == [folder.path]
    assert list(run_folders(tmp_path / "nowhere")) == []


def test_a_full_disk_is_named_with_the_file_that_did_not_fit(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`os.fsync` is where a disk that delays its allocations says so."""

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    before = folder.state()
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left on device") as told:
        folder.set_state("running")
    assert told.value.filename == str(folder.path / "state.json")
    with pytest.raises(OSError, match="No space left on device") as told:
        folder.append_metrics({"iteration": 0})
    assert told.value.filename == str(folder.path / "metrics.jsonl")
    assert folder.state() == before
    assert {path.name for path in folder.path.iterdir()} <= {
        "config.json", "state.json", "metrics.jsonl", "episodes", "weights", "logs",
    }  # fmt: skip


class OnFullDisk(RunFolder):
    """Of a disk that has room for state.json only where the old one was."""

    def write(self, name: str, data: bytes, **proof: Any) -> None:
        if name == "state.json" and (self.path / name).exists():
            raise OSError(errno.ENOSPC, "No space left on device", str(self.path / name))
        super().write(name, data, **proof)


def test_a_run_on_a_full_disk_does_not_stay_running(folder: RunFolder) -> None:
    running = folder.set_state("running", new_attempt=True)
    OnFullDisk(folder.path).settle("failed", error="the disk is full", by="a test")
    found = folder.state()
    assert (found.state, found.error) == ("failed", "the disk is full")
    assert (found.attempt, found.created_unix_s) == (running.attempt, running.created_unix_s)
