"""Who may write into a run folder."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.runs import lock
from bpn_shared.runs.folder import Ownership, OwnershipLostError, RunFolder, RunOwnedError
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.network import NetworkSpec

BLOB = WeightBlob.random(NetworkSpec(1, 1, 2), np.random.default_rng(0))
WRITES: list[Callable[[Ownership], object]] = [
    lambda owner: owner.set_state("stopped"),
    lambda owner: owner.append_metrics({"iteration": 0}),
    lambda owner: owner.append_rewards(0, [[1.0]]),
    lambda owner: owner.write_weights(BLOB),
    lambda owner: owner.write_episode(0, 0, b"episode"),
    lambda owner: owner.write_checkpoint(b"checkpoint"),
    lambda owner: owner.set_aside(owner.folder.path / "state.json"),
]

WRITER = """
import sys
from pathlib import Path
from bpn_shared.runs.folder import OwnershipLostError, RunFolder

folder = RunFolder(Path(sys.argv[1]))
with folder.owned("first") as owner:
    owner.begin_attempt()
    try:
        for count in range(10**9):
            owner.append_metrics({"iteration": count})
            owner.write_episode(count, 0, b"of the first")
            owner.write_checkpoint(b"of the first")
            owner.set_state("running")
    except OwnershipLostError:
        sys.exit(17)
"""


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder.create(tmp_path, UUID(int=1), RunConfig.bare("reaching"))


def content(folder: RunFolder) -> dict[Path, bytes]:
    files = (path for path in folder.path.rglob("*") if path.is_file() and path.name != ".lock")
    return {path: path.read_bytes() for path in files}


def test_its_owner_may_write_everything(folder: RunFolder) -> None:
    with folder.owned("first") as owner:
        assert owner.begin_attempt() == 1
        for write in WRITES[:-1]:
            write(owner)
    assert folder.state().state == "stopped"
    assert [record["iteration"] for record in folder.metrics()] == [0]
    assert folder.rewards() == {0: [[1.0]]}
    assert folder.newest_weights().content_sha256() == BLOB.content_sha256()
    assert folder.episode_path(0, 0).read_bytes() == b"episode"
    assert folder.checkpoint_path.read_bytes() == b"checkpoint"


@pytest.mark.parametrize("write", WRITES)
def test_an_owner_whose_lock_was_taken_away_writes_nothing_once_another_has_begun(
    folder: RunFolder, write: Callable[[Ownership], object]
) -> None:
    with folder.owned("first") as first:
        first.begin_attempt()
        (folder.path / ".lock").unlink()
        with folder.owned("second") as second:
            first.append_metrics({"iteration": 0})  # it has not begun yet
            assert second.begin_attempt() == 2
            before = content(folder)
            with pytest.raises(OwnershipLostError, match=r"at attempt 2 of second: .*attempt 1"):
                write(first)
            assert content(folder) == before
            second.append_metrics({"iteration": 1})


@pytest.mark.parametrize("write", WRITES)
def test_how_others_say_that_a_run_ended_stands(
    folder: RunFolder, write: Callable[[Ownership], object]
) -> None:
    with folder.owned("first") as owner:
        owner.begin_attempt()
        folder.set_state("queued")  # asked for again, after it was given up
        before = content(folder)
        with pytest.raises(OwnershipLostError, match="at attempt 1 of nobody yet"):
            write(owner)
        assert content(folder) == before


def test_two_that_own_a_run_one_after_the_other_have_two_attempts(folder: RunFolder) -> None:
    with folder.owned("same") as first:
        first.begin_attempt()
    with folder.owned("same") as second:
        assert second.begin_attempt() == 2
        with pytest.raises(OwnershipLostError):
            first.set_state("stopped")


def test_a_run_is_settled_by_others_only_without_an_owner(folder: RunFolder) -> None:
    with folder.owned("first") as owner:
        owner.begin_attempt()
        with pytest.raises(RunOwnedError, match="being learned by first"):
            folder.settle("failed", error="x", by="the registry")
        assert folder.state().state == "running"
    assert folder.settle("stopped", by="the registry").attempt == 1
    assert folder.settle("failed", error="it died", by="the registry").error == "it died"
    for state in ("stopped", "failed"):
        assert folder.settle(state, by="the registry").error == "it died"  # type: ignore[arg-type]


def test_a_silent_owner_is_replaced_and_a_lively_one_is_not(folder: RunFolder) -> None:
    path = folder.path / ".lock"
    with folder.owned("first") as first:
        first.begin_attempt()
        assert folder.is_owned()
        os.utime(path, (0, time.time() - lock.SILENT_S - 5))
        assert not folder.is_owned()
        with folder.owned("second", patience_s=0.0) as second:
            assert second.begin_attempt() == 2
            assert folder.is_owned()
            with pytest.raises(OwnershipLostError):
                first.append_metrics({"iteration": 0})
            second.append_metrics({"iteration": 0})
        assert not folder.is_owned()
    assert [path.name for path in folder.path.glob(".*")] == [".lock"]


def test_an_owner_of_a_version_that_does_not_touch_its_lock_is_never_silent(
    folder: RunFolder,
) -> None:
    path = folder.path / ".lock"
    with folder.owned("first"):
        path.write_text("learner-of-before")
        os.utime(path, (0, 0))
        assert folder.is_owned()
        with (
            pytest.raises(RunOwnedError, match="learned by learner-of-before"),
            folder.owned("second", patience_s=0.0),
        ):
            pass


def test_an_owner_touches_its_lock(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch, wait_for: Callable[..., None]
) -> None:
    monkeypatch.setattr(lock, "_TOUCH_S", 0.01)
    path = folder.path / ".lock"
    with folder.owned("first"):
        os.utime(path, (0, 0))
        wait_for(lambda: time.time() - path.stat().st_mtime < lock.SILENT_S, "a touch")
        os.utime(path, (0, 0))
        wait_for(lambda: time.time() - path.stat().st_mtime < lock.SILENT_S, "another touch")
    assert not [thread for thread in threading.enumerate() if thread.name == "lock"]


def test_what_is_no_lock_file_is_said_in_one_line(folder: RunFolder, tmp_path: Path) -> None:
    path = folder.path / ".lock"
    for make in (path.mkdir, lambda: path.symlink_to(tmp_path / "x"), lambda: os.mkfifo(path)):
        make()
        with pytest.raises(ConfigError, match=r"\.lock.*remove it"), folder.owned("first"):
            pass
        path.rmdir() if path.is_dir() else path.unlink()
    assert not (tmp_path / "x").exists()


def test_a_run_whose_state_is_missing_goes_on_as_the_next_attempt(folder: RunFolder) -> None:
    folder.append_metrics({"iteration": 0, "attempt": 4})
    (folder.path / "state.json").unlink()
    assert (folder.state().state, folder.state().attempt) == ("lost", 4)
    with folder.owned("first") as owner:
        assert owner.begin_attempt() == 5


@pytest.mark.parametrize("given_up", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_process_that_was_frozen_writes_nothing_after_another_has_begun(
    folder: RunFolder, seed: int, given_up: bool, wait_for: Callable[..., None]
) -> None:
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(folder.path)])
    try:
        wait_for(lambda: len(folder.metrics()) > 3, "the first writer")
        # at whatever moment: between two writes, between proof and write, within one
        threading.Event().wait(random.Random(seed).uniform(0, 0.02))
        process.send_signal(signal.SIGSTOP)
        wait_for(lambda: _state_of(process.pid) == "T", "the freeze")
        (folder.path / ".lock").unlink()
        if given_up:  # by the registry, and asked for again
            folder.settle("failed", error="it died", by="the registry")
            folder.set_state("queued")
        with folder.owned("second") as second:
            assert second.begin_attempt() == 2
            before = content(folder)
            process.send_signal(signal.SIGCONT)
            assert process.wait(60) == 17
            assert content(folder) == before
    finally:
        process.kill()
        process.wait()


def _state_of(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
