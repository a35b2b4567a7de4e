import json
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn.cli import main
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.about import About, SweepFile
from bpn_dashboard.registry.progress import Progress
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig

CONFIG = RunConfig.for_task("reaching", seed=3, hidden_units=24)


def record(iteration: int, return_px: float) -> dict[str, Any]:
    return {
        "iteration": iteration,
        "return_px": return_px,
        "length": 20.0,
        "weights_version": iteration + 1,
    }


@given(
    returns=st.lists(st.floats(-900, 0), max_size=12),
    repeated=st.sets(st.integers(0, 11)),
    reads=st.sets(st.integers(0, 30)),
)
def test_progress_read_piece_by_piece_is_that_of_the_whole_file(
    tmp_path_factory: Any, returns: list[float], repeated: set[int], reads: set[int]
) -> None:
    folder = RunFolder.create(tmp_path_factory.mktemp("runs"), UUID(int=1), CONFIG)
    progress = Progress(folder)
    lines = 0
    for iteration, value in enumerate(returns):
        for _ in range(2 if iteration in repeated else 1):
            folder.append_metrics(record(iteration, value))
            lines += 1
            if lines in reads:
                with (folder.path / "metrics.jsonl").open("a") as file:
                    file.write('{"iteration": ')  # a line that is being written, or was cut
                progress.read()
    seen = progress.read()
    assert seen == Progress(folder).read()
    assert seen["iteration"] == len(returns)
    if returns:
        assert seen["weights_version"] == len(returns)
        assert seen["return_last"] == returns[-1]
        assert seen["return_best"] == max(returns)
        assert np.isclose(seen["return_mean_last_5"], np.mean(returns[-5:]))


def columns(row: RunRow | SweepRow) -> dict[str, Any]:
    return {
        column.key: getattr(row, column.key)
        for column in row.__table__.columns
        if column.key not in ("updated_at", "folder_at")  # when row and folder were written
    }


def all_rows(store: RunStore) -> list[dict[str, Any]]:
    rows = [*store.find(RunFilter(archived=None)), *store.page_sweeps()]
    return [columns(row) for row in rows]


def test_a_lost_database_is_rebuilt_from_the_folders(tmp_path: Path, capsys: Any) -> None:
    runs_dir = tmp_path / "runs"
    file = runs_dir / ".dashboard.sqlite"
    runs_dir.mkdir()
    database = Database(sqlite_url(file))
    store = RunStore(database, runs_dir)
    plain = store.create(CONFIG, name="plain", notes="n", tags=["t"], actor="a")
    renamed = store.create(CONFIG, actor="a")
    store.update(renamed.id, renamed.rev, name="renamed", notes="better", actor="a")
    stopped = store.create(CONFIG, actor="a")
    store.request_stop(stopped.id, "a")
    store.archive(stopped.id, "a")
    sweep = store.create_sweep(
        "s",
        {"task": "reaching"},
        {"alpha": [0.5, 0.9]},
        [1, 2],
        actor="a",
        place=ConnectedWorkers(),
    )
    finished = store.folder(plain.id)
    finished.set_state("running", new_attempt=True)
    for iteration in range(3):
        finished.append_metrics(record(iteration, -100.0 + iteration))
    finished.set_state("finished")
    store.observe({plain.id: {"state": "finished", "attempt": 1} | Progress(finished).read()})
    before = all_rows(store)
    assert len(before) == 3 + 4 + 1
    database.close()
    for part in runs_dir.glob(".dashboard.sqlite*"):
        part.unlink()

    assert main(["dashboard", "reindex", "--runs-dir", str(runs_dir)]) == 0
    assert capsys.readouterr().out == "7 runs and 1 sweeps indexed, 0 removed\n"
    database = Database(sqlite_url(file))
    store = RunStore(database, runs_dir)
    assert all_rows(store) == before
    assert store.sweep_states([sweep.id]) == {sweep.id: {"queued": 4}}
    store.adopt()
    assert store.changed_folders() == []  # nothing is news
    database.close()


def test_what_cannot_be_read_is_named_and_what_is_gone_goes(tmp_path: Path, capsys: Any) -> None:
    runs_dir = tmp_path / "runs"
    runs_dir.mkdir()
    database = Database(sqlite_url(runs_dir / ".dashboard.sqlite"))
    store = RunStore(database, runs_dir)
    kept, damaged, gone = (store.create(CONFIG, actor="a") for _ in range(3))
    database.close()
    (runs_dir / damaged.id / "config.json").write_text('{"task": "reaching", "alpha": 2}')
    (runs_dir / gone.id).rename(tmp_path / "elsewhere")
    (runs_dir / "notes").mkdir()
    assert main(["dashboard", "reindex", "--runs-dir", str(runs_dir)]) == 1
    said = capsys.readouterr()
    assert said.out == "1 runs and 0 sweeps indexed, 2 removed\n"
    assert f"{damaged.id}/config.json: alpha = 2" in said.err
    database = Database(sqlite_url(runs_dir / ".dashboard.sqlite"))
    assert [row.id for row in RunStore(database, runs_dir).find()] == [kept.id]
    database.close()


def test_folders_of_other_programs_are_taken_in_and_watched(store: RunStore) -> None:
    folder = RunFolder.create(store.runs_dir, UUID(int=7), CONFIG)
    store.adopt()
    (row,) = store.find()
    assert (row.id, row.state, row.desired_state) == (str(folder.run), "stopped", "stopped")
    assert row.name == "reaching bpn seed 3"
    assert store.changed_folders() == []
    folder.set_state("running", new_attempt=True)
    assert [changed.id for changed in store.changed_folders()] == [row.id]
    RunFolder.create(store.runs_dir, UUID(int=8), CONFIG)
    (store.runs_dir / str(UUID(int=8)) / "config.json").write_text("{")
    store.adopt()
    assert len(store.find()) == 1


def test_a_flipped_bit_of_what_people_said_is_found_and_old_files_are_read(
    store: RunStore,
) -> None:
    row = store.create(CONFIG, name="a name", actor="a")
    sweep = store.create_sweep(
        "s",
        {"task": "reaching"},
        {"alpha": [0.5]},
        [1, 2],
        actor="a",
        place=ConnectedWorkers(lambda: None, list),
    )
    folder = store.folder(row.id)
    about, of_sweep = folder.path / "about.json", SweepFile.path(store.runs_dir, sweep.id)
    assert About.read(folder).name == "a name"
    assert SweepFile.read(store.runs_dir, of_sweep.name).seeds == [1, 2]

    def read() -> None:
        About.read(folder)
        SweepFile.read(store.runs_dir, of_sweep.name)

    for file, before, after in ((about, b"a name", b"a nbme"), (of_sweep, b"0.5", b"0.4")):
        whole = file.read_bytes()
        file.write_bytes(whole.replace(before, after))
        with pytest.raises(ConfigError, match=f"{file}: it was changed .* restore it"):
            read()
        values = json.loads(whole)
        del values["sha256"]
        file.write_text(json.dumps(values))  # as before there were digests
        read()


def test_about_is_what_people_said(store: RunStore) -> None:
    row = store.create(CONFIG, name="x", actor="a")
    store.request_stop(row.id, "a")
    about = json.loads((store.runs_dir / row.id / "about.json").read_text())
    assert about["name"] == "x"
    assert about["desired_state"] == "stopped"
    assert about["rev"] == store.get(row.id).rev
