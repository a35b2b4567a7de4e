"""Runs that are removed and brought back: files in use, links, a full disk, two callers at once."""

import os
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import UUID

import pytest
from disks import no_file_grows
from hypothesis import given, settings
from hypothesis import strategies as st

from bpn_shared.runs import lock
from bpn_shared.runs.folder import OwnershipLostError, RunFolder, RunOwnedError, run_folders
from bpn_shared.runs.trash import NotThereError, OccupiedError, Trash
from bpn_shared.spec.config import ConfigError, RunConfig

RUN = UUID(int=1)
NAMES = st.from_regex(r"[a-z.][a-z0-9.]{0,8}", fullmatch=True).filter(lambda n: n.strip("."))


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder.create(tmp_path, RUN, RunConfig.bare("reaching"))


@pytest.fixture
def trash(tmp_path: Path) -> Trash:
    return Trash(tmp_path, kept_s=100.0)


def everything(top: Path) -> dict[str, bytes | str | None]:
    """What lies below a directory: contents, targets of links, None for directories."""

    def of(path: Path) -> bytes | str | None:
        if path.is_symlink():
            return os.readlink(path)
        return None if path.is_dir() else path.read_bytes()

    return {str(path.relative_to(top)): of(path) for path in sorted(top.rglob("*"))}


@settings(max_examples=30)
@given(
    files=st.dictionaries(
        st.lists(NAMES, min_size=1, max_size=3).map("/".join), st.binary(max_size=50)
    ),
    links=st.dictionaries(NAMES, st.sampled_from(["/etc/passwd", "..", "nowhere", "config.json"])),
    full=st.booleans(),
)
def test_what_is_removed_and_restored_is_as_it_was(tmp_path_factory, files, links, full) -> None:
    runs_dir = tmp_path_factory.mktemp("runs")
    folder = RunFolder.create(runs_dir, RUN, RunConfig.bare("reaching"))
    for name, data in files.items():
        path = folder.path / name
        if not any(part.is_file() for part in (path, *path.parents)) and not path.is_dir():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    for name, target in links.items():
        if not os.path.lexists(folder.path / name):
            os.symlink(target, folder.path / name)
    before, trash = everything(folder.path), Trash(runs_dir)
    if full:
        with no_file_grows():
            trash.put(str(RUN), "me")
    else:
        trash.put(str(RUN), "me")
    assert list(run_folders(runs_dir)) == []
    assert everything(trash.path / str(RUN)) == before
    trash.restore(str(RUN))
    assert everything(folder.path) == before
    assert everything(trash.path) == {}


def test_the_trash_says_who_and_until_when(folder: RunFolder, trash: Trash) -> None:
    other = RunFolder.create(folder.path.parent, UUID(int=2), RunConfig.bare("reaching"))
    first, second = trash.put(str(other.run), "you"), trash.put(str(RUN), "me")
    assert (first.by, second.by) == ("you", "me")
    assert second.until_unix_s == second.at_unix_s + 100.0
    assert trash.contents() == [second, first]
    assert Trash(folder.path.parent, kept_s=5.0).find(str(RUN)) == second  # as promised then
    with pytest.raises(ConfigError, match=r"is in the trash: `bpn runs restore 0+-0+-0+-0+-0+1`"):
        RunFolder.open(folder.path.parent, "1")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("note", [None, b"", b"{", b'{"by": 1}', b'{"at_unix_s": NaN}'])
def test_without_its_note_the_folders_time_counts(trash, note: bytes | None) -> None:
    with_note = trash.put(str(RUN), "me")
    path = trash.path / f"{RUN}.json"
    path.unlink() if note is None else path.write_bytes(note)
    (found,) = trash.contents()
    assert found.by == ""
    assert found.at_unix_s == pytest.approx(with_note.at_unix_s, abs=60.0)
    assert found.until_unix_s == found.at_unix_s + 100.0


@pytest.mark.usefixtures("folder")
def test_a_note_of_an_earlier_removal_does_not_count(trash: Trash) -> None:
    trash.put(str(RUN), "me")
    note = (trash.path / f"{RUN}.json").read_bytes()
    trash.restore(str(RUN))
    (trash.path / f"{RUN}.json").write_bytes(note)  # it died before this was taken away
    with no_file_grows():
        trash.put(str(RUN), "you")
    assert trash.contents()[0].by == ""


# Files in use


def test_a_run_that_is_being_learned_stays(folder: RunFolder, trash: Trash) -> None:
    with folder.owned("learner-1") as owner:
        owner.begin_attempt()
        with pytest.raises(RunOwnedError, match=r"learned by learner-1.*`bpn runs stop 0+-"):
            trash.put(str(RUN), "me")
        owner.append_metrics({"iteration": 0})
    trash.put(str(RUN), "me")
    with pytest.raises(FileNotFoundError), folder.owned("learner-2"):
        pass
    assert not folder.path.exists()


def test_the_owner_that_is_silent_keeps_nothing_and_writes_nothing(
    folder, trash, monkeypatch
) -> None:
    monkeypatch.setattr(lock, "SILENT_S", 0.0)
    monkeypatch.setattr(lock, "_TOUCH_S", 1000.0)
    with folder.owned("frozen") as owner:
        owner.begin_attempt()
        os.utime(folder.path / ".lock", (1.0, 1.0))
        trash.put(str(RUN), "me")
        with pytest.raises(OwnershipLostError):
            owner.append_metrics({"iteration": 0})
        with pytest.raises(OwnershipLostError):
            owner.write_checkpoint(b"x")
    assert not folder.path.exists()


def test_a_file_that_is_open_is_read_to_its_end(folder: RunFolder, trash: Trash) -> None:
    folder.write("logs/edge-0.log", b"said before")
    with folder.open_file("logs/edge-0.log") as file:
        trash.put(str(RUN), "me")
        trash.delete(str(RUN))
        assert file.read() == b"said before"
    with pytest.raises(FileNotFoundError):
        folder.write("logs/edge-0.log", b"said after")
    assert everything(folder.path.parent) == {".trash": None}


# Links


@pytest.fixture
def outside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    outside = tmp_path_factory.mktemp("outside")
    (outside / "precious").write_bytes(b"precious")
    return outside


def test_nothing_is_deleted_behind_a_link(folder: RunFolder, trash: Trash, outside: Path) -> None:
    (folder.path / "exports").symlink_to(outside)
    (folder.path / "weights" / "1.bpnw").symlink_to(outside / "precious")
    trash.put(str(RUN), "me")
    trash.delete(str(RUN))
    assert everything(outside) == {"precious": b"precious"}
    assert everything(folder.path.parent) == {".trash": None}


@pytest.mark.parametrize("of", ["run", "trash", "removed", "lock"])
def test_a_link_is_not_taken_for_a_folder(folder, trash, outside: Path, of: str) -> None:
    run = str(RUN)
    if of == "run":
        shutil.rmtree(folder.path)
        folder.path.symlink_to(outside)
    elif of == "trash":
        trash.path.symlink_to(outside)
    elif of == "removed":
        trash.path.mkdir()
        (trash.path / run).symlink_to(outside)
    else:
        (folder.path / ".lock").symlink_to(outside / "lock")
    assert trash.contents() == []
    acts = [trash.restore] if of == "removed" else [lambda run: trash.put(run, "me")]
    for act in acts:
        with pytest.raises((OSError, ConfigError, NotThereError)):
            act(run)
    if of in ("removed", "trash"):
        assert folder.is_complete()
    assert everything(outside) == {"precious": b"precious"}
    if of == "removed":
        trash.delete(run)
        assert everything(outside) == {"precious": b"precious"}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "name", ["..", ".", "", ".trash", "a/b", "\0", str(RUN).replace("-", ""), "/etc"]
)
def test_only_ids_are_names(trash: Trash, name: str) -> None:
    trash.put(str(RUN), "me")
    for act in (
        lambda: trash.put(name, "me"),
        lambda: trash.restore(name),
        lambda: trash.delete(name),
    ):
        with pytest.raises(NotThereError):
            act()
    assert trash.names() == [str(RUN)]


# A full disk


def test_a_full_disk_hinders_neither_removal_nor_deletion(folder: RunFolder, trash: Trash) -> None:
    other = RunFolder.create(folder.path.parent, UUID(int=2), RunConfig.bare("reaching"))
    with no_file_grows():
        assert trash.put(str(RUN), "me").run == str(RUN)
        trash.put(str(other.run), "me")
        trash.restore(str(RUN))
        trash.delete(str(other.run))
        trash.sweep_up()
    assert folder.is_complete()
    assert everything(trash.path) == {}


def test_on_a_disk_without_any_room(tmp_path: Path) -> None:
    """Where not even an empty file can be made, if this machine lets us mount such a disk; else no byte."""
    script = """
import errno, sys
from pathlib import Path
from uuid import UUID
from bpn_shared.spec.config import RunConfig
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.trash import Trash

runs = Path(sys.argv[1])
folder, trash = RunFolder.create(runs, UUID(int=1), RunConfig.bare("reaching")), Trash(runs)
trash.path.mkdir()
try:
    for number in range(10**6):
        (runs / f"filler-{number}").write_bytes(bytes(4096))
except OSError as error:
    assert error.errno in (errno.ENOSPC, errno.EFBIG), error
assert trash.put(str(folder.run), "me").run == str(folder.run)
assert not folder.path.exists() and trash.find(str(folder.run)).by == ""
trash.restore(str(folder.run))
assert folder.is_complete()
trash.put(str(folder.run), "me")
trash.delete(str(folder.run))
assert trash.names() == []
print("done")
"""
    mount = f'mount -t tmpfs -o size=256k,nr_inodes=40 tmpfs "{tmp_path}" && exec "$@"'
    small_disk = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-ec", mount, "sh"]
    if subprocess.run([*small_disk, "true"], capture_output=True, check=False).returncode != 0:
        small_disk = ["sh", "-c", 'ulimit -f 8 && exec "$@"', "sh"]
        script = script.replace("bytes(4096)", "bytes(10**6)")
    done = subprocess.run(
        [*small_disk, sys.executable, "-c", script, str(tmp_path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.stdout == "done\n", done.stderr


# Two callers


@pytest.mark.parametrize("act", ["put", "restore", "delete"])
def test_of_many_callers_one_does_it_and_the_others_are_told(folder, trash, act: str) -> None:
    run = str(RUN)
    if act != "put":
        trash.put(run, "me")
    acts = {"put": lambda: trash.put(run, "me"), "restore": lambda: trash.restore(run)}
    one = acts.get(act, lambda: trash.delete(run))
    begin = threading.Barrier(8)

    def call(_: int) -> str:
        begin.wait()
        try:
            one()
        except NotThereError as told:
            return str(told)
        return ""

    with ThreadPoolExecutor(8) as pool:
        said = list(pool.map(call, range(8)))
    assert said.count("") == 1
    where = {"put": "is in the trash (", "restore": "where it was", "delete": "there is no run"}[
        act
    ]
    assert all(where in text for text in said if text)
    assert folder.is_complete() == (act == "restore")


def test_restored_and_deleted_at_once_it_is_whole_or_gone(tmp_path: Path) -> None:
    trash = Trash(tmp_path)
    for number in range(20):
        folder = RunFolder.create(tmp_path, UUID(int=number), RunConfig.bare("reaching"))
        before = everything(folder.path)
        trash.put(str(folder.run), "me")
        begin = threading.Barrier(2)

        def call(act, run=str(folder.run), begin=begin) -> bool:
            begin.wait()
            try:
                act(run)
            except NotThereError:
                return False
            return True

        with ThreadPoolExecutor(2) as pool:
            restored, deleted = pool.map(call, (trash.restore, trash.delete))
        assert restored != deleted
        assert everything(folder.path) == (before if restored else {})


def test_two_of_one_id_are_never_mixed(folder: RunFolder, trash: Trash) -> None:
    trash.put(str(RUN), "me")
    again = RunFolder.create(folder.path.parent, RUN, RunConfig.bare("reaching", seed=5))
    with pytest.raises(OccupiedError, match=r"there is a run .* again: remove that one first"):
        trash.restore(str(RUN))
    with pytest.raises(OccupiedError, match="in the trash already: delete that one first"):
        trash.put(str(RUN), "me")
    assert again.config().seed == 5
    assert len(trash.contents()) == 1


@pytest.mark.usefixtures("folder")
def test_what_an_interrupted_deletion_has_left_is_swept_up(trash: Trash) -> None:
    trash.put(str(RUN), "me")
    (trash.path / str(RUN)).rename(trash.path / f".deleting.{RUN}.0a1b")
    assert trash.contents() == []
    trash.sweep_up()
    assert everything(trash.path) == {}
