"""The API does what its description says, whatever it is sent (schemathesis, all its checks)."""

import json
from pathlib import Path

import hypothesis
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st
from schemathesis import GenerationMode
from schemathesis.specs.openapi.checks import positive_data_acceptance

from bpn_dashboard.access.limits import WrongTokens
from bpn_dashboard.access.tokens import Tokens
from bpn_dashboard.api.app import create_app
from bpn_dashboard.api.context import Context
from bpn_dashboard.api.export_openapi import openapi_text
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series import store as series_store
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.series.points import Points
from bpn_shared.counters import Counters
from bpn_shared.spec.config import RunConfig

COMMITTED = Path(__file__).parents[2] / "services/dashboard/web/openapi.json"
OPERATIONS = [
    f"{method.upper()} {path}"
    for path, methods in json.loads(COMMITTED.read_text())["paths"].items()
    for method in methods
]

MORE_THAN_A_SCHEMA = {
    "GET /api/v1/audit",  # cursors are authenticated
    "GET /api/v1/heatmap",  # config.KEY must be a value of that key
    "GET /api/v1/runs",
    "GET /api/v1/runs/failures",
    "GET /api/v1/runs/ids",
    "GET /api/v1/runs/overview",
    "GET /api/v1/runs/{run_id}/logs",
    "GET /api/v1/sweeps",
    "PATCH /api/v1/runs/{run_id}",  # what people read has no invisible characters
    "POST /api/v1/comparison",  # either runs or filter
    "POST /api/v1/comparison/episodes",
    "POST /api/v1/runs",  # values must fit together, and an environment be there
    "POST /api/v1/runs/check",
    "POST /api/v1/runs/prune",  # one of two rules at least
    "POST /api/v1/runs/tags",
    "POST /api/v1/runs/values",  # columns are of metrics and keys that there are
    "POST /api/v1/series/query",
    "POST /api/v1/sweeps",  # at most so many runs, and seed not in both grid and seeds
    "POST /api/v1/tokens",
    "POST /api/v1/views",  # addresses lead to pages of the dashboard
    "PUT /api/v1/views/{view_id}",
}
"""What they refuse with 422 although a JSON schema cannot say it."""


@pytest.fixture(scope="module")
def api(tmp_path_factory):
    """The application on a few runs, described by itself."""
    folder = tmp_path_factory.mktemp("dashboard")
    database, counters = Database(sqlite_url(folder / "index.sqlite")), Counters()
    runs = RunStore(database, folder / "runs")
    ingest = Ingest(folder / "runs", database, counters)
    for seed in range(3):
        run = runs.create(RunConfig.for_task("reaching", seed=seed), actor="test")
        with database.writing() as session:
            points = Points.written(range(10), [float(i) for i in range(10)])
            series_store.append(session, run.id, {"return_px": points})
    ingest.start()
    patient = WrongTokens(limit=100_000)  # wrong tokens are among what is tried
    app = create_app(Context(database, runs, ingest, counters, wrong_tokens=patient))
    _, token = Tokens(database).issue("token", "test", "admin")
    schema = schemathesis.openapi.from_asgi(
        "/api/v1/openapi.json",
        app,
        headers={"Authorization": f"Bearer {token}", "Host": "localhost"},
    )
    yield schema, token
    ingest.close()
    database.close()


@pytest.mark.parametrize("label", OPERATIONS)
def test_every_operation_keeps_its_promises(api, label) -> None:
    schema, token = api
    operation = schema.find_operation_by_label(label)
    headers = {"Authorization": f"Bearer {token}", "Host": "localhost"}

    values = operation.body or operation.path_parameters or operation.query
    excluded = [positive_data_acceptance] if label in MORE_THAN_A_SCHEMA else []
    modes = list(GenerationMode) if values else [GenerationMode.POSITIVE]

    @hypothesis.settings(
        max_examples=8,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],
    )
    @hypothesis.given(st.one_of([operation.as_strategy(generation_mode=m) for m in modes]))
    def call(case) -> None:
        case.call_and_validate(headers=headers, excluded_checks=excluded)

    call()


def test_the_web_uis_copy_is_up_to_date() -> None:
    """If not: python -m bpn_dashboard.api.export_openapi > services/dashboard/web/openapi.json"""
    assert json.loads(COMMITTED.read_text()) == json.loads(openapi_text())


def test_names_of_models_say_nothing_of_the_programs_modules() -> None:
    """Two models of one name get their modules' paths in front, and generators of clients give up on them."""
    schemas = json.loads(openapi_text())["components"]["schemas"]
    assert [name for name in schemas if "__" in name] == []
    titles = [schema["title"] for schema in schemas.values() if "title" in schema]
    assert len(titles) == len(set(titles))
