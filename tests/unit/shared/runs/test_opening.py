"""Nothing planted in a run folder leads out of it, or makes a reader wait."""

import os
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.opening import (
    ForeignFileError,
    file_names,
    folder_names,
    open_file,
    read_file,
)
from bpn_shared.spec.config import ConfigError, RunConfig

RUN = UUID(int=1)
PARTS = st.lists(st.sampled_from(("a", "b", "größe", "x y")), min_size=1, max_size=5)


@given(parts=PARTS, data=st.binary(max_size=100), linked=st.integers(0, 5))
def test_one_link_anywhere_in_a_name_is_refused_and_without_one_it_is_read(
    parts: list[str], data: bytes, linked: int
) -> None:
    with tempfile.TemporaryDirectory() as directory:
        root, elsewhere = Path(directory, "root"), Path(directory, "elsewhere")
        name = Path(*parts, "file")
        (root / name).parent.mkdir(parents=True)
        (root / name).write_bytes(data)
        assert read_file(root, name) == data
        write_atomically(root / name, data + b"1", root=root)
        assert read_file(root, name) == data + b"1"
        moved = root / Path(*name.parts[: min(linked, len(parts)) + 1])
        moved.rename(elsewhere)
        moved.symlink_to(elsewhere)
        with pytest.raises(ForeignFileError):
            open_file(root, name)
        if linked < len(parts):
            with pytest.raises(ForeignFileError):
                write_atomically(root / name, b"changed", root=root)
            assert (root / name).read_bytes() == data + b"1"
            assert file_names(root, name.parent) == []
        else:  # the file itself: the link is replaced, and what it led to stays
            write_atomically(root / name, b"changed", root=root)
            assert read_file(root, name) == b"changed"
            assert elsewhere.read_bytes() == data + b"1"


@given(st.sampled_from(("..", "../file", "a/../../file", "/etc/passwd", "a\0b")))
def test_a_name_that_leaves_its_folder_is_refused(name: str) -> None:
    with pytest.raises(ForeignFileError):
        open_file(Path("/tmp"), name)


@pytest.fixture
def odd(tmp_path: Path) -> Iterator[Path]:
    """A directory with one of everything."""
    (tmp_path / "file.log").write_text("said")
    (tmp_path / "folder.log").mkdir()
    os.mkfifo(tmp_path / "pipe.log")
    (tmp_path / "link.log").symlink_to("file.log")
    (tmp_path / "dangling.log").symlink_to("gone")
    (tmp_path / "linked").symlink_to("folder.log")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "socket.log"))
        yield tmp_path


@pytest.mark.parametrize("name", ["folder", "pipe", "link", "dangling", "socket"])
def test_what_is_no_regular_file_is_refused_at_once(odd: Path, name: str) -> None:
    with pytest.raises(ForeignFileError):
        open_file(odd, f"{name}.log")


def test_only_files_and_folders_of_its_own_are_listed(odd: Path) -> None:
    assert file_names(odd, suffix=".log") == ["file.log"]
    assert folder_names(odd) == ["folder.log"]
    assert file_names(odd, "linked") == file_names(odd, "gone") == file_names(odd, "file.log") == []
    with pytest.raises(FileNotFoundError):
        open_file(odd, "gone.log")


def test_a_linked_run_folder_is_no_run(tmp_path: Path) -> None:
    elsewhere = RunFolder.create(tmp_path / "elsewhere", RUN, RunConfig.bare("reaching"))
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / str(RUN)).symlink_to(elsewhere.path)
    with pytest.raises(ConfigError, match="no run"):
        RunFolder.open(tmp_path / "runs", str(RUN))
    linked = RunFolder(tmp_path / "runs" / str(RUN))
    for read in (linked.config, linked.state, linked.newest_weights):
        with pytest.raises(ConfigError):
            read()
    with pytest.raises(ConfigError, match="is a link"):
        linked.set_state("failed")
    assert elsewhere.state().state == "queued"


@pytest.mark.timeout(20)
def test_a_pipe_in_a_run_folder_makes_nobody_wait(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path, RUN, RunConfig.bare("reaching"))
    for name in ("config.json", "state.json", "metrics.jsonl", ".lock"):
        (folder.path / name).unlink(missing_ok=True)
        os.mkfifo(folder.path / name)
    os.mkfifo(folder.path / "weights" / "000000.bpnw")
    for read in (
        folder.config, folder.state, folder.newest_weights, folder.metrics, folder.is_owned
    ):  # fmt: skip
        with pytest.raises(ConfigError):
            read()


def test_links_that_wait_for_a_writer_lead_nowhere(tmp_path: Path) -> None:
    folder, precious = (
        RunFolder.create(tmp_path, RUN, RunConfig.bare("reaching")),
        tmp_path / "precious",
    )
    precious.write_text("precious")
    for name in ("state.json", "state.json.new"):
        (folder.path / name).unlink(missing_ok=True)
        (folder.path / name).symlink_to(precious)
    with pytest.raises(ConfigError, match="is a link"):
        folder.set_state("running")
    (folder.path / "state.json").unlink()
    folder.set_state("running")
    assert precious.read_text() == "precious"
    assert folder.state().state == "running"
