"""What programs of before have left shows in the dashboard, in one group with equal runs of today."""

import json
import shutil
from pathlib import Path

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import create_engine, text

from bpn_dashboard.api.groups import group_runs
from bpn_dashboard.database.engine import MIGRATIONS, Database, sqlite_url
from bpn_dashboard.registry.store import RunStore
from bpn_shared.runs.creation import configure
from bpn_shared.runs.digests import seal
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

GOLDEN = Path(__file__).parents[2] / "golden/0.1.0"
OLD = {path.parent.name: path for path in sorted(GOLDEN.glob("*/*")) if path.is_dir()}


def copied(name: str, runs_dir: Path) -> str:
    shutil.copytree(OLD[name], runs_dir / OLD[name].name)
    return OLD[name].name


@pytest.mark.parametrize("name", OLD)
def test_runs_of_version_0_1_0_show(name: str, store: RunStore, client) -> None:
    run_id = copied(name, store.runs_dir)
    store.adopt()
    (run,) = client.get("/api/v1/runs").json()["items"]
    assert (run["id"], run["error"], run["iteration"], run["iterations"]) == (run_id, "", 2, 6)
    assert run["algorithm"] == name.split("-")[1]
    assert (run["config"]["hidden_units"], run["config"]["replay_iterations"]) == (4, 2)
    assert (run["config"]["backend"], run["config"]["kernel"]) == ("native", "")
    assert run["config"]["bootstrap_terminals"] is ("gym:" not in run["task"])
    assert run["summary"]["returns"]["last"] is not None
    task = client.get(f"/api/v1/runs/{run_id}/task").json()
    assert task["name"] == run["task"]
    assert client.get(f"/api/v1/runs/{run_id}/episodes?iteration=0").status_code == 200


def test_they_are_in_one_group_with_equal_runs_of_today(store: RunStore, client) -> None:
    """Whose seed is another, and which are done with something else."""
    run_id = copied("reaching-bpn", store.runs_dir)
    store.adopt()
    old = store.folder(run_id).config()
    equal = RunConfig.parse(dict(old))
    for changes in ({}, {"seed": 6, "backend": "torch", "kernel": "golden", "tensorboard": True}):
        store.create(RunConfig.parse(dict(equal) | changes), actor="test")
    store.create(RunConfig.parse(dict(equal) | {"alpha": 0.5}), actor="test")
    hashes = [
        run["config_hash"] for run in client.get("/api/v1/runs?sort=created_at").json()["items"]
    ]
    assert (hashes[0] == hashes[1], len(set(hashes))) == (True, 3)
    groups = group_runs(store.find(), "all_but_seed")
    assert [len(group.seeds) for group in groups] == [3, 1]
    assert groups[1].values == {"alpha": 0.5}


def test_a_database_of_before_is_renamed_and_hashed_anew(tmp_path: Path) -> None:
    url = sqlite_url(tmp_path / "dashboard.sqlite")
    database = Database(url)
    store = RunStore(database, tmp_path / "runs")
    made = store.create(RunConfig.for_task("reaching", hidden_units=24), actor="me")

    class Anywhere:
        def probe(self, asked: object) -> None:
            raise AssertionError(asked)

        def check(self, config: RunConfig) -> None:
            """Everything can be done."""

    config = {"task": "reaching", "bootstrap_terminals": False}
    store.create_sweep("s", config, {"hidden_units": [8, 9], "backend": ["native", "torch"]}, [],
                       actor="me", place=Anywhere())  # fmt: skip
    database.close()
    options = Config()
    options.set_main_option("script_location", str(MIGRATIONS))
    engine = create_engine(url)
    with engine.connect() as connection:
        options.attributes["connection"] = connection
        command.downgrade(options, "0006")
        connection.commit()
        found = json.loads(connection.execute(text("SELECT config FROM runs")).first()[0])
        sweep = connection.execute(text("SELECT config, grid FROM sweeps")).one()
        connection.execute(text("UPDATE runs SET config_hash = 'of before'"))
        connection.commit()
    engine.dispose()
    assert (found["nodes"], found["engine"], "hidden_units" in found) == (24, "fast", False)
    assert json.loads(sweep[0]) == {"task": "reaching", "mask_terminals": True}
    assert json.loads(sweep[1]) == {"nodes": [8, 9], "engine": ["fast", "plain"]}
    database = Database(url)
    store = RunStore(database, tmp_path / "runs")
    assert store.get(made.id).config_hash == ""
    store.adopt()
    row = store.get(made.id)
    assert (row.config_hash, row.config) == (made.config_hash, made.config)
    assert store.page_sweeps(after=None, limit=1)[0].grid == {
        "hidden_units": [8, 9], "backend": ["native", "torch"],
    }  # fmt: skip
    database.close()


def test_a_sweeps_file_of_before_has_todays_names(store: RunStore) -> None:
    sweeps = store.runs_dir / "sweeps"
    sweeps.mkdir(parents=True)
    (sweeps / "x.json").write_bytes(
        seal({"id": "x", "name": "old", "config": {"task": "reaching", "engine": "plain"},
              "grid": {"nodes": [1], "mask_terminals": [True, False]}, "seeds": [], "created_at": 1.0})
    )  # fmt: skip
    store.index.rebuild()
    (sweep,) = store.page_sweeps(after=None, limit=9)
    assert sweep.config == {"task": "reaching", "backend": "torch"}
    assert sweep.grid == {"hidden_units": [1], "bootstrap_terminals": [False, True]}


@pytest.mark.parametrize(("method", "path", "body", "said"), [
    ("POST", "/runs", {"config": {"task": "reaching", "nodes": 3}}, "nodes is called hidden_units now"),
    ("POST", "/sweeps", {"name": "s", "config": {"task": "reaching"}, "grid": {"engine": ["fast"]}},
     "engine is called backend now (fast is native, plain is torch)"),
    ("GET", "/runs?config.batch=8", None, "batch is called batch_size now"),
    ("GET", "/heatmap?x=datasets&y=alpha", None, "datasets is called replay_iterations now"),
])  # fmt: skip
def test_names_of_before_are_refused_with_those_of_today(
    method: str, path: str, body: dict | None, said: str, client
) -> None:
    answer = client.request(method, f"/api/v1{path}", json=body)
    assert answer.status_code == 422
    assert said in answer.text


def test_values_out_of_a_run_folder_are_those_that_are_asked_for() -> None:
    """A run that is cloned from an old one, as the start form does, is accepted."""
    config = RunFolder(OLD["tracking-dqn"]).config()
    values = config.model_dump(exclude={"task_spec", "algorithm_spec"})

    class Anywhere:
        def probe(self, asked: object) -> None:
            raise AssertionError(asked)

        def check(self, config: RunConfig) -> None:
            """Everything can be done."""

    assert configure(values, Anywhere()) == config
