"""`bpn runs` on a folder where no dashboard runs: the same words, and the folder is the truth."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from disks import no_file_grows

from bpn.cli import main
from bpn_dashboard.api.models import Run
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.store import RunStore
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.state import encode_state
from bpn_shared.spec.config import RunConfig

Bpn = Callable[..., Any]


@pytest.fixture
def bpn(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Bpn:
    """Does `bpn runs ...`; returns what it printed, as JSON where that is asked for; what it refused if it did."""

    def run(*arguments: str, status: int = 0) -> Any:
        assert main(["runs", *arguments, "--runs-dir", str(tmp_path)]) == status
        said = capfd.readouterr()
        if status:
            assert said.out in ("", "[]\n")
            return said.err
        assert said.err == ""
        return json.loads(said.out) if "--json" in arguments else said.out

    return run


def make(runs_dir: Path, number: int, **values: Any) -> RunFolder:
    folder = RunFolder.create(runs_dir, UUID(int=number), RunConfig.for_task("reaching", **values))
    folder.append_metrics(
        {"iteration": 0, "return_px": -10.0 - number, "length": 20.0, "weights_version": 1}
    )
    return folder


def test_runs_are_listed_as_a_dashboard_lists_them(tmp_path: Path, bpn: Bpn) -> None:
    for number in (1, 2, 3):
        make(tmp_path, number, seed=number).set_state("finished" if number < 3 else "stopped")
    database = Database(sqlite_url(tmp_path / "elsewhere" / "db.sqlite"))
    store = RunStore(database, tmp_path)
    store.adopt()
    for arguments, runs, sort in (
        ([], RunFilter(), "-created_at"),
        (["--sort=return_best"], RunFilter(), "return_best"),
        (["--state", "finished"], RunFilter(states=("finished",)), "-created_at"),
        (["--search", "SEED 2"], RunFilter(search="SEED 2"), "-created_at"),
        (["--archived"], RunFilter(archived=True), "-created_at"),
        (["--limit", "1"], RunFilter(), "-created_at"),
    ):
        limit = 1 if "--limit" in arguments else 50
        page = store.page(runs, sort=sort.lstrip("-"), descending=sort.startswith("-"), limit=limit)
        expected = [Run.of(row).model_dump(mode="json") for row in page.rows]
        assert bpn("ls", "--json", *arguments) == expected, arguments
    assert bpn("show", "2", "--json")["seed"] == 2
    assert "1 of 3; --limit" in bpn("ls", "--limit", "1")
    database.close()


def test_removed_listed_and_restored(tmp_path: Path, bpn: Bpn) -> None:
    for number in (1, 2):
        make(tmp_path, number)
    before = bpn("ls", "--json")
    said = bpn("rm", "1", "2")
    assert said.count("removed ") == 2
    assert "bpn runs restore 000000000001 --runs-dir" in said
    assert bpn("ls", "--json") == []
    (second, first) = bpn("trash", "--json")
    assert {first["id"][-1], second["id"][-1]} == {"1", "2"}
    assert first["kept_until_unix_s"] == pytest.approx(time.time() + 7 * 86_400, abs=60.0)
    assert "reaching bpn seed" in bpn("trash")
    assert "is in the trash" in bpn("rm", "1", status=2)
    assert [item["id"] for item in bpn("restore", "1", "2", "--json")] == [
        str(UUID(int=1)), str(UUID(int=2))
    ]  # fmt: skip
    assert bpn("ls", "--json") == before
    assert "no run in the trash matches '1'" in bpn("restore", "1", status=2)


def test_one_that_is_learned_stays_and_the_others_go(tmp_path: Path, capsys: Any) -> None:
    busy, idle = make(tmp_path, 1), make(tmp_path, 2)
    with busy.owned("bpn train"):
        status = main(["runs", "rm", "1", "2", "--json", "--runs-dir", str(tmp_path)])
    said = capsys.readouterr()
    assert status == 1
    assert (
        f"being learned by bpn train: wait for its end, or stop it there (`bpn runs stop {busy.run}`)"
        in said.err
    )
    assert [item["id"] for item in json.loads(said.out)] == [str(idle.run)]
    assert busy.is_complete()
    assert not idle.is_complete()


def test_a_wrong_name_is_told_before_anything_is_done(tmp_path: Path, bpn: Bpn) -> None:
    folder = make(tmp_path, 1)
    assert "matches 'x'" in bpn("rm", "1", "x", status=2)
    assert folder.is_complete()


def test_a_damaged_run_can_be_removed(tmp_path: Path, bpn: Bpn) -> None:
    folder = make(tmp_path, 1)
    folder.write("config.json", b"{")
    folder.write("state.json", b"{")
    assert bpn("rm", "1", "--json")[0]["id"] == str(folder.run)


def test_pruned_and_emptied(tmp_path: Path, bpn: Bpn) -> None:
    for number in (1, 2, 3):
        folder = make(tmp_path, number)
        state = folder.set_state("finished").model_copy(update={"updated_unix_s": number * 1e6})
        folder.write("state.json", encode_state(state))
    assert "which runs?" in bpn("prune", status=2)
    assert "keep -1" in bpn("prune", "--keep", "-1", status=2)
    for days in ("nan", "inf", "-1"):
        assert f"older than {float(days)}: must be" in bpn("prune", "--older-than", days, status=2)
    assert bpn("prune", "--keep", "2", "--dry-run").startswith(f"would remove {UUID(int=1)}")
    assert len(bpn("ls", "--json")) == 3
    told = bpn("prune", "--keep", "1", "--older-than", "1", "--json")
    assert [(one["id"], one["ok"]) for one in told] == [(str(UUID(int=n)), True) for n in (1, 2)]
    assert bpn("prune", "--keep", "1") == "nothing to remove\n"
    assert bpn("empty-trash", "--expired", "--json") == []
    assert bpn("empty-trash", "2", "--json") == [{"id": str(UUID(int=2))}]
    assert bpn("empty-trash") == "1 run deleted for good\n"
    assert bpn("trash", "--json") == []
    assert list((tmp_path / ".trash").iterdir()) == []


def test_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(tmp_path, 1)
    said: list[str] = []
    monkeypatch.setattr("builtins.print", lambda text, **_: said.append(text))  # capture is files
    with no_file_grows():
        for command in (["rm", "1"], ["restore", "1"], ["rm", "1"], ["empty-trash"]):
            assert main(["runs", *command, "--json", "--runs-dir", str(tmp_path)]) == 0
    assert json.loads(said[-1]) == [{"id": str(UUID(int=1))}]


@pytest.mark.parametrize(
    "arguments",
    [["ls"], ["rm", "1"], ["restore", "1"], ["trash"], ["prune", "--keep", "1"], ["empty-trash"]],
)
def test_a_folder_that_is_not_there_is_named(
    tmp_path: Path, capsys: Any, arguments: list[str]
) -> None:
    assert main(["runs", *arguments, "--runs-dir", str(tmp_path / "none")]) == 2
    assert f"--runs-dir {tmp_path}/none: there is no such folder" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["start", "reaching"], ["stop", "1"], ["resume", "1"]])
def test_what_needs_workers_needs_a_dashboard(
    tmp_path: Path, bpn: Bpn, arguments: list[str]
) -> None:
    make(tmp_path, 1)
    assert "start one with `bpn up" in bpn(*arguments, status=2)
