import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.database.series_tables import MetricRow
from bpn_dashboard.database.tables import AuditRow, RunRow
from bpn_dashboard.registry.columns import OWN
from bpn_dashboard.registry.errors import (
    FilterError,
    RunBusyError,
    RunStateError,
    StaleError,
    UnknownRunError,
    UnknownSweepError,
)
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.registry.workplace import ConnectedWorkers
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig

CONFIG = RunConfig.for_task("reaching", seed=3, hidden_units=24)


def test_a_new_run_is_a_folder_a_row_and_an_audit_entry(
    store: RunStore, database: Database
) -> None:
    row = store.create(CONFIG, name="first", notes="n", tags=["a", "b"], actor="alice")
    folder = RunFolder.open(store.runs_dir, row.id)
    assert folder.config() == CONFIG
    assert folder.state().state == row.state == "queued"
    assert row.desired_state == "running"
    assert store.get(row.id).config == CONFIG.model_dump(
        mode="json", exclude={"task_spec", "algorithm_spec"}
    )
    with database.reading() as session:
        (entry,) = session.query(AuditRow)
    assert (entry.actor, entry.action, entry.subject) == ("alice", "create", row.id)


def test_a_run_without_a_name_is_called_by_what_it_is(store: RunStore) -> None:
    assert store.create(CONFIG, actor="a").name == "reaching bpn seed 3"


def test_two_runs_with_equal_configurations_have_equal_hashes(store: RunStore) -> None:
    first, second = store.create(CONFIG, actor="a"), store.create(CONFIG, actor="a")
    third = store.create(CONFIG.model_copy(update={"seed": 4}), actor="a")
    assert first.config_hash == second.config_hash != third.config_hash


def test_an_update_needs_the_newest_revision_and_progress_does_not_change_it(
    store: RunStore,
) -> None:
    row = store.create(CONFIG, actor="a")
    store.observe({row.id: {"iteration": 3, "state": "running"}})
    changed = store.update(row.id, row.rev, notes="better", tags=["x"], actor="b")
    assert (changed.notes, changed.tags, changed.name) == ("better", ["x"], row.name)
    assert changed.rev == row.rev + 1
    with pytest.raises(StaleError, match=f"is at revision {changed.rev}, not {row.rev}"):
        store.update(row.id, row.rev, name="late", actor="c")
    assert store.update(row.id, changed.rev, notes="better", actor="b").rev == changed.rev


@pytest.mark.parametrize("act", ["get", "update", "request_stop", "request_resume", "archive"])
def test_an_unknown_run_is_named(store: RunStore, act: str) -> None:
    arguments: dict[str, tuple[Any, ...]] = {"get": (), "update": (1,)}
    extra = {"actor": "a"} if act == "update" else {}
    with pytest.raises(UnknownRunError, match="there is no run 0198"):
        getattr(store, act)("0198", *arguments.get(act, ("a",)), **extra)


def test_stop_resume_archive_follow_the_rules(store: RunStore) -> None:
    run = store.create(CONFIG, actor="a").id
    with pytest.raises(RunBusyError, match="is queued: stop it"):
        store.archive(run, "a")
    assert store.request_stop(run, "a").state == "stopped"
    rev = store.request_stop(run, "a").rev
    assert store.request_stop(run, "a").rev == rev  # idempotent
    assert store.archive(run, "a").archived_at is not None
    with pytest.raises(RunStateError, match="is archived"):
        store.request_resume(run, "a")
    assert store.unarchive(run, "a").archived_at is None
    assert store.request_resume(run, "a").state == "queued"
    store.observe({run: {"state": "running"}})
    assert store.request_stop(run, "a").state == "stopping"
    assert store.request_resume(run, "a").desired_state == "running"
    store.observe({run: {"state": "failed", "error": "broken"}})
    store.folder(run).set_state("failed", error="broken")
    resumed = store.request_resume(run, "a")
    assert (resumed.state, resumed.error) == ("queued", "")
    assert store.folder(run).state().state == "queued"
    store.observe({run: {"state": "finished"}})
    with pytest.raises(RunStateError, match="all its iterations are done"):
        store.request_resume(run, "a")
    assert store.request_stop(run, "a").desired_state == "running"  # it is over all the same


def test_listeners_hear_of_every_change_once_it_is_stored(store: RunStore) -> None:
    heard: list[tuple[str, str]] = []
    store.audience.subscribe(lambda rows: heard.extend((row.id, row.state) for row in rows))
    run = store.create(CONFIG, actor="a").id
    store.observe({run: {"state": "running"}})
    store.observe({run: {"state": "running"}})
    assert heard == [(run, "queued"), (run, "running")]


def test_a_sweep_makes_its_runs_or_nothing(store: RunStore) -> None:
    sweep = store.create_sweep(
        "alphas", {"task": "reaching", "hidden_units": 24}, {"alpha": [0.5, 0.9]}, [1, 2, 3],
        actor="a", place=ConnectedWorkers(),
    )  # fmt: skip
    rows = store.find(RunFilter(sweep_id=sweep.id))
    points = sorted((row.config["alpha"], row.seed) for row in rows)
    assert points == [(alpha, seed) for alpha in (0.5, 0.9) for seed in (1, 2, 3)]
    assert store.sweep_states([sweep.id]) == {sweep.id: {"queued": 6}}
    assert [found.id for found in store.page_sweeps()] == [sweep.id]
    store.stop_sweep(sweep.id, "a")
    assert store.sweep_states([sweep.id]) == {sweep.id: {"stopped": 6}}
    with pytest.raises(ConfigError, match="alpha = 2"):
        store.create_sweep(
            "wrong", {"task": "reaching"}, {"alpha": [2]}, [], actor="a", place=ConnectedWorkers()
        )
    assert len(list(store.runs_dir.glob("*/config.json"))) == 6
    with pytest.raises(UnknownSweepError, match="there is no sweep x"):
        store.get_sweep("x")
    older = store.page_sweeps(after=sweep.id)
    assert older == []


# Finding

values = st.none() | st.floats(-100, 0).map(lambda value: round(value, 1))
summaries = st.lists(st.tuples(values, st.sampled_from(["a", "b", "c"])), max_size=25)


def fill(database: Database, returns: list[tuple[float | None, str]], prefix: str) -> None:
    """Rows without folders: what is tested is the search."""
    with database.writing() as session:
        for number, (value, name) in enumerate(returns):
            session.add(
                RunRow(
                    id=f"{prefix}-{number:06d}", name=name, task="reaching", algorithm="bpn",
                    seed=number, config=CONFIG.model_dump() | {"alpha": number % 4 / 4},
                    config_hash="", state="finished",
                    desired_state="running", attempt=1, iteration=number % 7, iterations=50,
                    weights_version=None, return_last=value, return_best=value, error="",
                    return_mean_last_5=value, length_last=None, notes="", tags=[],
                    sweep_id=None, archived_at=None, created_at=float(number // 3),
                    updated_at=0.0, rev=1,
                )
            )  # fmt: skip
            session.add(
                MetricRow(
                    run_id=f"{prefix}-{number:06d}", name="loss", n=1, first=0, last=0, revision=0,
                    mean_5=value,
                )
            )  # fmt: skip


def value_of(row: RunRow, column: str) -> Any:
    """What `fill` gave a row in that column."""
    if column.startswith("metric."):
        return row.return_last
    return row.config["alpha"] if column == "config.alpha" else getattr(row, column, None)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    returns=summaries,
    sort=st.sampled_from([*OWN, "config.alpha", "metric.loss.mean_5"]),
    descending=st.booleans(),
    limit=st.integers(1, 7),
    inserted=summaries,
)
def test_pages_show_each_run_once_in_order_whatever_is_inserted_meanwhile(
    tmp_path_factory: pytest.TempPathFactory,
    returns: list[tuple[float | None, str]],
    sort: str,
    descending: bool,
    limit: int,
    inserted: list[tuple[float | None, str]],
) -> None:
    database = Database(sqlite_url(tmp_path_factory.mktemp("db") / "x.sqlite"))
    fill(database, returns, "old")
    store = RunStore(database, Path("nowhere"))
    seen, after, first = [], None, True
    while first or after is not None:
        page = store.page(sort=sort, descending=descending, after=after, limit=limit)
        assert len(page.rows) <= limit
        seen += page.rows
        after = None if page.next_after is None else tuple(json.loads(json.dumps(page.next_after)))
        if first:
            assert page.total == len(returns)
            fill(database, inserted, "new")
            first = False
    assert len({row.id for row in seen}) == len(seen)
    old = [row for row in seen if row.id.startswith("old")]
    assert len(old) == len(returns)
    keys = [(value_of(row, sort), row.id) for row in seen]
    present = [key for key in keys if key[0] is not None]
    assert keys[: len(present)] == present  # without a value: last
    assert present == sorted(present, reverse=descending)
    database.close()


@pytest.fixture
def three(store: RunStore) -> dict[str, str]:
    """Runs that differ in everything, by name."""
    made = [
        store.create(CONFIG, name="Straße", notes="with 100%", tags=["best", "größe"], actor="a"),
        store.create(RunConfig.for_task("tracking", alpha=0.5), name="two", actor="a"),
        store.create(RunConfig.for_task("tracking", algorithm="bqn"), name="three", actor="a"),
    ]
    return {row.id: row.name for row in made}


@pytest.mark.parametrize(
    ("runs", "names"),
    [
        (RunFilter(), {"Straße", "two", "three"}),
        (RunFilter(search="stra"), {"Straße"}),
        (RunFilter(search="0%"), {"Straße"}),
        (RunFilter(search="%"), {"Straße"}),
        (RunFilter(search="best"), {"Straße"}),
        (RunFilter(search="TWO"), {"two"}),
        (RunFilter(search="STRASSE"), {"Straße"}),
        (RunFilter(search="GRÖSSE"), {"Straße"}),
        (RunFilter(search="gro\u0308ße"), {"Straße"}),  # as another keyboard writes the ö
        (RunFilter(search="größe with stra"), {"Straße"}),
        (RunFilter(search="größe two"), set()),
        (RunFilter(search="["), set()),
        (RunFilter(search='"'), set()),
        (RunFilter(task="tracking"), {"two", "three"}),
        (RunFilter(task="tracking", algorithm="bqn"), {"three"}),
        (RunFilter(states=("queued", "failed")), {"Straße", "two", "three"}),
        (RunFilter(states=("failed",)), set()),
        (RunFilter(archived=True), set()),
        (RunFilter(config={"alpha": "0.5"}), {"two"}),
        (RunFilter(config={"alpha": ".950"}), {"Straße", "three"}),
        (RunFilter(config={"hidden_units": "24", "seed": "3"}), {"Straße"}),
        (RunFilter(config={"algorithm": "bqn"}), {"three"}),
        (RunFilter(config={"bootstrap_terminals": "true"}), {"Straße", "two", "three"}),
        (RunFilter(config={"bootstrap_terminals": "false"}), set()),
    ],
)
def test_filters(store: RunStore, three: dict[str, str], runs: RunFilter, names: set[str]) -> None:
    assert {three[row.id] for row in store.find(runs)} == names
    assert store.page(runs).total == len(names)


@pytest.mark.parametrize(
    ("runs", "sort", "message"),
    [
        (RunFilter(), "colour", "'colour' is no column; there are created_at"),
        (RunFilter(config={"colour": "1"}), "name", "config.colour is unknown; one of: task"),
        (RunFilter(config={"alpha": "x"}), "name", "config.alpha = 'x': Input should be a valid"),
    ],
)
def test_wrong_filters_are_named(store: RunStore, runs: RunFilter, sort: str, message: str) -> None:
    with pytest.raises(FilterError, match=message):
        store.page(runs, sort=sort)
