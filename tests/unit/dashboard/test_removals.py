"""Runs that are removed, restored and pruned by the registry: the rows say what the folders say."""

import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from uuid import UUID

import pytest
from disks import no_file_grows
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import func, select

from bpn_dashboard.api.context import Context
from bpn_dashboard.database.audit import OURSELVES
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.database.series_tables import ChunkRow, MetricRow, SourceRow
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry import removals as removals_module
from bpn_dashboard.registry.errors import RunBusyError, UnknownRunError
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.removals import Removals, keep_tidy
from bpn_dashboard.registry.retention import Rule
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_dashboard.series.ingest import Ingest
from bpn_shared.counters import Counters
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.trash import DAY_S, Trash
from bpn_shared.spec.config import ConfigError, RunConfig

CONFIG = RunConfig.for_task("reaching")


@pytest.fixture
def removals(context: Context) -> Removals:
    return context.removals


def stopped(store: RunStore, **about: Any) -> RunRow:
    run = store.create(CONFIG, actor="a", **about)
    return store.request_stop(run.id, "a")


def record(iteration: int) -> dict[str, Any]:
    return {
        "iteration": iteration,
        "return_px": -5.0 + iteration,
        "length": 20.0,
        "weights_version": iteration,
    }


def shown(row: RunRow) -> dict[str, Any]:
    columns = {column.key: getattr(row, column.key) for column in RunRow.__table__.columns}
    del columns["updated_at"]  # when the row was written, not the folder
    return columns


def counted(database: Database, table: Any) -> int:
    with database.reading() as session:
        return session.scalar(select(func.count()).select_from(table)) or 0


texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


@settings(max_examples=8)
@given(
    name=texts, notes=texts, tags=st.lists(texts, max_size=3),
    end=st.sampled_from(["finished", "failed", "stopped"]), archived=st.booleans(), iterations=st.integers(0, 4),
)  # fmt: skip
def test_removed_and_restored_a_run_is_shown_as_before(
    tmp_path_factory, empty_database, name, notes, tags, end, archived, iterations
) -> None:
    folder = tmp_path_factory.mktemp("dashboard")
    shutil.copy(empty_database, folder / "db.sqlite")
    database = Database(sqlite_url(folder / "db.sqlite"))
    store = RunStore(database, folder / "runs")
    context = Context(database, store, Ingest(store.runs_dir, database, Counters()), Counters())
    other, run = stopped(store), stopped(store, name=name, notes=notes, tags=tags)
    for iteration in range(iterations):
        store.folder(run.id).append_metrics(record(iteration))
    store.folder(run.id).set_state(end, error="why" if end == "failed" else "")
    if archived:
        store.archive(run.id, "a")
    database.close()
    for file in folder.glob("db.sqlite*"):
        file.unlink()
    shutil.copy(
        empty_database, folder / "db.sqlite"
    )  # so that all that is shown is what folders say
    store.adopt()
    context.ingest.poll()
    before, points = shown(store.get(run.id)), counted(database, ChunkRow)

    removed = context.removals.remove(run.id, "me")
    assert [row.id for row in store.find(RunFilter(archived=None))] == [other.id]
    assert counted(database, MetricRow) == counted(database, SourceRow) == 0
    with pytest.raises(UnknownRunError, match=r"removed by me .* ago: `bpn runs restore"):
        context.removals.remove(run.id, "you")
    assert context.removals.contents() == [(removed, before["name"])]

    restored = context.removals.restore(run.id, "me")
    assert shown(restored) == before
    context.ingest.take_in([restored])
    assert counted(database, ChunkRow) == points
    assert context.removals.contents() == []
    database.close()


@pytest.mark.parametrize("state", ["queued", "running"])
def test_a_run_that_somebody_works_on_stays(store, removals, state: str) -> None:
    run = store.create(CONFIG, actor="a")
    store.observe({run.id: {"state": state}})
    with pytest.raises(
        RunBusyError, match=rf"is {state}: stop it before .*`bpn runs stop {run.id}`"
    ):
        removals.remove(run.id, "me")
    assert store.folder(run.id).is_complete()


def test_a_run_that_is_learned_without_the_dashboard_stays(store, removals) -> None:
    run = stopped(store)
    busy = pytest.raises(RunBusyError, match="being learned by bpn train")
    with store.folder(run.id).owned("bpn train"), busy:
        removals.remove(run.id, "me")
    assert removals.remove(run.id, "me").by == "me"


def test_what_others_remove_and_restore_the_rows_follow(store, context: Context) -> None:
    """As `bpn runs rm` on a machine that does not reach the dashboard, and as `rm -r`."""
    trash, gone = Trash(store.runs_dir), []
    store.audience.mourn(gone.extend)
    trashed, erased, kept = (stopped(store) for _ in range(3))
    store.folder(trashed.id).append_metrics(record(0))
    context.ingest.poll()
    assert counted(context.database, MetricRow) > 0
    trash.put(trashed.id, "somebody")
    shutil.rmtree(store.runs_dir / erased.id)
    with pytest.raises(UnknownRunError):  # before anybody has noticed
        store.update(erased.id, erased.rev, notes="x", actor="a")
    assert not (store.runs_dir / erased.id).exists()
    store.adopt()
    assert [row.id for row in store.find()] == [kept.id]
    assert sorted(gone) == sorted([trashed.id, erased.id])
    assert counted(context.database, MetricRow) == 0
    trash.restore(trashed.id)
    store.adopt()
    assert {row.id for row in store.find()} == {kept.id, trashed.id}
    context.ingest.take_in([store.get(trashed.id)])
    assert counted(context.database, MetricRow) > 0


def test_a_disk_that_is_not_there_takes_no_rows_away(store) -> None:
    run = stopped(store)
    store.runs_dir.rename(store.runs_dir.with_name("unmounted"))
    store.adopt()
    assert store.get(run.id).id == run.id


def test_a_sweep_goes_on_without_a_run_and_gets_it_back(store, removals) -> None:
    sweep = store.create_sweep(
        "s", {"task": "reaching"}, {"alpha": [0.5, 0.9]}, [], actor="a", place=ConnectedWorkers()
    )
    first, second = (row.id for row in store.find(RunFilter(sweep_id=sweep.id)))
    store.stop_sweep(sweep.id, "a")
    removals.remove(first, "me")
    assert store.sweep_states([sweep.id]) == {sweep.id: {"stopped": 1}}
    assert [row.id for row in store.find(RunFilter(sweep_id=sweep.id))] == [second]
    assert removals.restore(first, "me").sweep_id == sweep.id
    assert store.sweep_states([sweep.id]) == {sweep.id: {"stopped": 2}}


def test_on_a_full_disk_it_is_removed_and_its_row_follows_when_there_is_room(
    store, removals
) -> None:
    run, other = stopped(store), stopped(store)
    store.adopt()
    with no_file_grows():
        removed = removals.remove(run.id, "me")
        assert (removed.run, removed.by) == (run.id, "me")
        for _ in range(2):
            assert [row.id for row in store.find()] == [other.id]
            assert store.page().total == 1
            assert store.ids() == {other.id}
            with pytest.raises(UnknownRunError):
                store.get(run.id)
            store.audience.tell_gone(store.index.drop_vanished())
        assert removals.restore(run.id, "me").id == run.id
        removals.remove(run.id, "me")
        (deleted,) = removals.empty("me")
        assert (deleted.run, deleted.trouble) == (run.id, None)
    store.adopt()
    assert store.index.gone == frozenset()
    assert [row.id for row in store.find()] == [other.id]


@pytest.mark.parametrize("act", ["remove", "restore", "delete"])
def test_of_several_callers_one_does_it_and_the_others_are_told(store, removals, act: str) -> None:
    run = stopped(store)
    if act != "remove":
        removals.remove(run.id, "before")
    begin = threading.Barrier(4)

    def call(caller: int) -> str:
        begin.wait()
        try:
            getattr(removals, act)(run.id, f"caller {caller}")
        except UnknownRunError as told:
            return str(told)
        return ""

    with ThreadPoolExecutor(4) as pool:
        said = list(pool.map(call, range(4)))
    assert said.count("") == 1
    if act == "remove":
        winner = f"caller {said.index('')}"
        assert all(winner in text for text in said if text)
    assert store.ids() == ({run.id} if act == "restore" else frozenset())


def test_removed_here_and_behind_our_back_at_once_it_is_removed_once(store, removals) -> None:
    trash = Trash(store.runs_dir)
    for _ in range(5):
        run, begin = stopped(store), threading.Barrier(2)

        def call(act, run_id=run.id, begin=begin) -> bool:
            begin.wait()
            try:
                act(run_id, "me")
            except ValueError:  # both say it in their way
                return False
            return True

        with ThreadPoolExecutor(2) as pool:
            assert sum(pool.map(call, (removals.remove, trash.put))) == 1
        store.adopt()
        assert store.ids() == frozenset()
        assert trash.find(run.id) is not None


# Retention


@given(
    ages_days=st.lists(st.tuples(st.floats(0, 100), st.floats(0, 100)), max_size=12),
    states=st.lists(
        st.sampled_from(["queued", "running", "finished", "stopped", "lost"]), min_size=12, max_size=12
    ),
    tagged=st.sets(st.integers(0, 11)),
    keep=st.none() | st.integers(0, 14), older=st.none() | st.floats(0, 100),
)  # fmt: skip
def test_a_rule_takes_what_it_says_and_nothing_else(ages_days, states, tagged, keep, older) -> None:
    now_s = 1e9
    rows = [
        RunRow(
            id=str(UUID(int=n)), state=states[n], tags=["keep"] if n in tagged else [],
            created_at=now_s - max(made, idle) * DAY_S, updated_at=now_s - idle * DAY_S,
        )
        for n, (made, idle) in enumerate(ages_days)
    ]  # fmt: skip
    taken = Rule(keep, older).outdated(rows, now_s)
    newest_first = sorted(rows, key=lambda row: (row.created_at, row.id), reverse=True)
    for rank, row in enumerate(newest_first):
        protected = row.state not in ("finished", "stopped") or "keep" in row.tags
        too_new = (keep is not None and rank < keep) or (
            older is not None and now_s - row.updated_at <= older * DAY_S
        )
        assert (row in taken) == (not protected and not too_new)
    assert taken == [row for row in reversed(newest_first) if row in taken]


def test_a_rule_that_means_everything_is_none() -> None:
    with pytest.raises(ConfigError, match="which runs"):
        Rule().check()
    with pytest.raises(ConfigError, match="keep -1: must be 0 or more"):
        Rule(keep=-1).check()
    with pytest.raises(ConfigError, match="older than nan"):
        Rule(older_than_days=float("nan")).check()


def test_pruned_runs_can_be_restored_and_a_dry_run_does_nothing(store, removals) -> None:
    runs = [stopped(store, name=str(n)) for n in range(4)]
    told = removals.prune(Rule(keep=1), "me", dry_run=True)
    assert [one.run for one in told] == [run.id for run in runs[:3]]
    assert len(store.find()) == 4
    with store.folder(runs[1].id).owned("bpn train"):
        done = removals.prune(Rule(keep=1), "me")
    assert [one.run for one in done] == [run.id for run in runs[:3]]
    assert [isinstance(one.trouble, RunBusyError) for one in done] == [False, True, False]
    assert {row.id for row in store.find()} == {runs[1].id, runs[3].id}
    for one in (runs[0], runs[2]):
        removals.restore(one.id, "me")
    assert len(store.find()) == 4


def test_the_dashboard_tidies_up_by_itself(store, context: Context, monkeypatch, wait_for) -> None:
    monkeypatch.setattr(removals_module, "TIDY_S", 0.02)
    old, new = stopped(store), stopped(store)
    removals = Removals(context.database, store, Trash(store.runs_dir, kept_s=0.0))
    stop = threading.Event()
    tidying = threading.Thread(target=keep_tidy, args=(removals, Rule(keep=1), stop))
    tidying.start()
    try:
        wait_for(lambda: not removals.contents() and len(store.find()) == 1, "old runs to go")
    finally:
        stop.set()
        tidying.join()
    assert store.ids() == {new.id}
    assert not any(path.name.startswith(old.id) for path in store.runs_dir.rglob("*"))


def test_only_what_is_no_longer_kept_is_emptied(store, context: Context) -> None:
    short, long = stopped(store), stopped(store)
    Removals(context.database, store, Trash(store.runs_dir, kept_s=0.0)).remove(short.id, "me")
    context.removals.remove(long.id, "me")
    done = context.removals.empty(OURSELVES, expired_only=True)
    assert [one.run for one in done] == [short.id]
    assert [removed.run for removed, _ in context.removals.contents()] == [long.id]


def test_what_cannot_be_read_can_be_removed(store, removals) -> None:
    folder = RunFolder.create(store.runs_dir, UUID(int=3), CONFIG)
    folder.write("config.json", b"{")
    store.adopt()
    assert store.ids() == frozenset()
    removed = removals.remove(str(folder.run), "me")
    assert removals.contents() == [(removed, "? ? seed ?")]
    with pytest.raises(
        ConfigError, match=r"config\.json"
    ):  # it is back, and why it has no row is said
        removals.restore(str(folder.run), "me")
    assert (folder.path / "config.json").read_bytes() == b"{"
