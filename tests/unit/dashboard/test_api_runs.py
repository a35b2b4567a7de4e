"""Runs, sweeps, pages, errors, through HTTP."""

import contextlib
from uuid import UUID

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from paper import TASKS

from bpn_dashboard.access.guard import MAX_BODY_BYTES
from bpn_dashboard.api.pages import Cursors
from bpn_dashboard.api.problems import ApiError
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import OPTIONS, RunConfig


def create(client, **values):
    answer = client.post("/api/v1/runs", json={"config": {"task": "reaching"}} | values)
    assert answer.status_code == 201, answer.text
    return answer.json()


def test_a_run_is_made_with_the_tasks_preset(client, store) -> None:
    run = create(client, config={"task": "reaching", "alpha": 0.5}, name="a", tags=["x"])
    config = RunConfig.for_task("reaching", alpha=0.5)
    assert run["config"] == config.model_dump(mode="json", exclude={"task_spec", "algorithm_spec"})
    assert store.folder(run["id"]).config() == config
    assert (run["state"], run["name"], run["tags"], run["rev"]) == ("queued", "a", ["x"], 1)
    assert client.get(f"/api/v1/runs/{run['id']}").headers["etag"] == '"1"'


def test_the_hash_of_a_configuration_is_that_of_what_is_learned(client) -> None:
    """A value that is added later changes it in no run: those of then and now are told to be alike."""
    run = create(client, config={"task": "reaching", "seed": 3})
    assert run["config_hash"] == (
        "767ebf33faf5a921e9d5fcdc0ed2199a8a02f3db5b09f34e09ba436d4b2238ef"
    )


def test_a_run_tells_its_task_and_its_returns_unit(client) -> None:
    run = create(client, config={"task": "tracking"})
    task = client.get(f"/api/v1/runs/{run['id']}/task").json()
    assert (task["name"], task["title"], len(task["action_names"])) == ("tracking", "Tracking", 7)
    assert task["action_dims"] == [7]
    assert task["selection"] == "softmax"
    assert task["preset"]["steps"] == 40
    assert run["summary"]["returns"]["metric"] == "return_px"
    gym = create(client, config={"task": "gym:Some-v0", "actions": 3})
    assert (gym["summary"]["returns"]["metric"], gym["summary"]["returns"]["unit"]) == (
        "return",
        "",
    )


def test_a_run_of_a_task_that_is_not_installed_here_shows(client, store) -> None:
    """Its configuration has the task by value; a new run of it is refused, as nobody here knows it."""
    spec = TASKS["tracking"].model_copy(
        update={"name": "juggling", "action_names": ("left", "right"), "hold_action": 0}
    )
    config = RunConfig(task="juggling", task_spec=spec)
    run = UUID("01a201f9-821b-74c6-95eb-3f4ab1331c4c")
    RunFolder.create(store.runs_dir, run, config)
    store.index.adopt()
    shown = client.get(f"/api/v1/runs/{run}").json()
    assert (shown["task"], shown["error"], shown["config"]["actions"]) == ("juggling", "", 2)
    assert client.get(f"/api/v1/runs/{run}/task").json()["action_names"] == ["left", "right"]
    refused = client.post("/api/v1/runs", json={"config": {"task": "juggling"}})
    assert refused.status_code == 422
    assert (
        "task = 'juggling': unknown; one of: arm, gym:[MODULE:]ENVIRONMENT-ID, pan_tilt"
        in refused.json()["detail"]
    )


def test_what_a_run_cannot_begin_with_is_refused_and_leaves_nothing(client, store) -> None:
    source = create(client)["id"]
    for name, reason in ((source, "has no checkpoint yet"), ("00ff", "no run in")):
        config = {"task": "reaching", "init_from": name}
        answer = client.post("/api/v1/runs", json={"config": config})
        assert answer.status_code == 422
        assert reason in answer.text
    assert client.get("/api/v1/runs").json()["total"] == 1
    assert [
        path.name for path in store.runs_dir.iterdir() if path.is_dir() and path.name[0] != "."
    ] == [source]


def test_annotations_need_the_etag_that_was_seen(client) -> None:
    url = f"/api/v1/runs/{create(client)['id']}"
    assert client.patch(url, json={"notes": "n"}).status_code == 428
    changed = client.patch(url, json={"notes": "n"}, headers={"If-Match": '"1"'})
    assert (changed.json()["notes"], changed.headers["etag"]) == ("n", '"2"')
    stale = client.patch(url, json={"notes": "other"}, headers={"If-Match": '"1"'})
    assert (stale.status_code, stale.json()["type"]) == (412, "urn:bpn:problem:stale")
    assert client.get(url).json()["notes"] == "n"


def test_a_repeated_request_makes_one_run(client, client_of) -> None:
    body = {"config": {"task": "reaching"}, "name": "once"}
    key = {"Idempotency-Key": "k1"}
    first = client.post("/api/v1/runs", json=body, headers=key)
    again = client.post("/api/v1/runs", json=body, headers=key)
    assert (first.status_code, again.status_code) == (201, 201)
    assert first.json()["id"] == again.json()["id"] == again.headers["location"].split("/")[-1]
    other = client.post("/api/v1/runs", json=body | {"name": "x"}, headers=key)
    assert (other.status_code, other.json()["type"]) == (422, "urn:bpn:problem:idempotency-key")
    assert client_of("operator").post("/api/v1/runs", json=body, headers=key).status_code == 201
    assert client.get("/api/v1/runs").json()["total"] == 2


def test_a_request_that_failed_may_be_repeated_with_its_key(client, context, monkeypatch) -> None:
    def fault(*_arguments, **_values):
        raise RuntimeError("a fault in the program")

    body, key = {"config": {"task": "reaching"}}, {"Idempotency-Key": "k1"}
    with monkeypatch.context() as patched:
        patched.setattr(context.runs, "create", fault)
        failed = client.post("/api/v1/runs", json=body, headers=key)
    assert failed.status_code == 500
    assert "fault" not in failed.text
    assert failed.json()["request_id"] == failed.headers["x-request-id"]
    assert client.post("/api/v1/runs", json=body, headers=key).status_code == 201


def test_stop_resume_archive_and_bulk(client) -> None:
    runs = [create(client)["id"] for _ in range(3)]
    for action, state in (("stop", "stopped"), ("stop", "stopped"), ("resume", "queued")):
        answer = client.post(f"/api/v1/runs/{runs[0]}/{action}")
        assert (answer.status_code, answer.json()["state"]) == (200, state)
    busy = client.post(f"/api/v1/runs/{runs[0]}/archive")
    assert (busy.status_code, busy.json()["type"]) == (409, "urn:bpn:problem:run-busy")
    stopped = client.post("/api/v1/runs/bulk", json={"action": "stop", "ids": runs}).json()
    assert [result["ok"] for result in stopped["results"]] == [True, True, True]
    unknown = "00000000-0000-0000-0000-000000000000"
    body = {"action": "archive", "ids": [runs[0], unknown, runs[1]]}
    archived = client.post("/api/v1/runs/bulk", json=body).json()["results"]
    assert [(r["ok"], (r["problem"] or {}).get("status")) for r in archived] == [
        (True, None), (False, 404), (True, None),
    ]  # fmt: skip
    assert client.get("/api/v1/runs").json()["total"] == 1
    assert client.get("/api/v1/runs?archived=true").json()["total"] == 2
    assert client.post(f"/api/v1/runs/{runs[0]}/unarchive").json()["archived_at_unix_s"] is None


def test_pages_follow_each_other_while_runs_are_made(client) -> None:
    made = {create(client, name=f"n{i % 3}")["id"] for i in range(9)}
    seen, cursor = [], None
    while True:
        params = {"sort": "name", "limit": 2} | ({"cursor": cursor} if cursor else {})
        page = client.get("/api/v1/runs", params=params).json()
        seen += [item["id"] for item in page["items"]]
        create(client, name="n0")  # before the place where the next page begins
        if (cursor := page["next_cursor"]) is None:
            break
    assert len(seen) == len(set(seen))
    assert made <= set(seen)


def test_filters_by_configuration_and_state(client) -> None:
    create(client, config={"task": "reaching", "alpha": 0.5}, name="half", tags=["fast"])
    create(client, config={"task": "tracking", "seed": 3}, name="other")

    def names(query: str):
        return [item["name"] for item in client.get(f"/api/v1/runs?{query}").json()["items"]]

    assert names("config.alpha=0.5") == ["half"]
    assert names("config.seed=3&task=tracking") == ["other"]
    assert names("search=FAST") == ["half"]
    assert names("state=running,stopped") == []
    assert names("sort=name&state=queued") == ["half", "other"]


@pytest.mark.parametrize(
    ("query", "where"),
    [
        ("limit=0", "query.limit"),
        ("limit=201", "query.limit"),
        ("sort=secret", "query.sort"),
        ("unknown=1", "query.unknown"),
        ("config.unknown=1", "query.config.unknown"),
        ("archived=maybe", "query.archived"),
    ],
)
def test_wrong_queries_are_named(client, query, where) -> None:
    answer = client.get(f"/api/v1/runs?{query}")
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert where in [error["location"] for error in answer.json()["errors"]]


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"config": {}},
        {"config": {"task": "fly ing"}},
        {"config": {"task": "reaching", "alpha": 2}},
        {"config": {"task": "reaching", "alpha": "0.5"}},
        {"config": {"task": "reaching", "seed": True}},
        {"config": {"task": "reaching", "unknown": 1}},
        {"config": {"task": "reaching"}, "name": "n" * 201},
        {"config": {"task": "reaching"}, "extra": 1},
        [1],
    ],
)
def test_wrong_bodies_make_nothing(client, body) -> None:
    answer = client.post("/api/v1/runs", json=body)
    assert answer.status_code == 422
    assert answer.json()["errors"]
    assert client.get("/api/v1/runs").json()["total"] == 0


def test_a_configuration_that_no_task_can_have_says_why(client) -> None:
    answer = client.get("/api/v1/runs?config.alpha=many")
    assert (answer.status_code, answer.json()["type"]) == (422, "urn:bpn:problem:filter")
    assert "many" in answer.json()["detail"]


def test_a_text_that_a_database_cannot_hold_is_no_failure_of_ours(client) -> None:
    made = client.post("/api/v1/runs", json={"config": {"task": "reaching"}, "notes": "a\0b"})
    assert made.status_code in (201, 422)
    assert client.get("/api/v1/runs", params={"search": "\0"}).status_code in (200, 422)


def test_bodies_are_bounded_and_must_be_json(client) -> None:
    large = client.post(
        "/api/v1/runs",
        content=b'{"notes": "' + b"x" * MAX_BODY_BYTES + b'"}',
        headers={"Content-Type": "application/json"},
    )
    assert (large.status_code, large.json()["status"]) == (413, 413)

    chunks = [b"x" * 65536] * (MAX_BODY_BYTES // 65536 + 1)  # a length that no header tells
    chunked = client.post(
        "/api/v1/runs", content=iter(chunks), headers={"Content-Type": "application/json"}
    )
    assert chunked.status_code == 413
    for content_type in ("text/plain", "application/x-www-form-urlencoded"):
        form = client.post(
            "/api/v1/runs",
            content=b'{"config": {"task": "reaching"}}',
            headers={"Content-Type": content_type},
        )
        assert form.status_code == 422
    broken = client.post("/api/v1/runs", content=b"{", headers={"Content-Type": "application/json"})
    assert broken.json()["type"] == "urn:bpn:problem:invalid-request"


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/nope", 404),
        ("GET", "/api/v1/nope", 404),
        ("GET", "/api", 404),
        ("PUT", "/api/v1/runs", 405),
        ("GET", "/api/v1/runs/nope", 404),
        ("GET", "/api/v1/sweeps/nope", 404),
        ("GET", "/assets/nope.js", 404),
    ],
)
def test_what_is_not_there_is_a_problem_for_browsers_too(client, method, path, status) -> None:
    answer = client.request(method, path, headers={"Accept": "text/html"})
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert answer.headers["content-type"] == "application/problem+json"


def test_configurations_are_compared(client) -> None:
    one = create(client, config={"task": "reaching", "alpha": 0.5})["id"]
    two = create(client, config={"task": "reaching", "seed": 7})["id"]
    diff = client.get(f"/api/v1/runs/{one}/config-diff", params={"other": two}).json()
    assert diff["differences"] == [
        {"key": "alpha", "this": 0.5, "other": 0.95}, {"key": "seed", "this": 0, "other": 7},
    ]  # fmt: skip
    assert diff["same"] == len(OPTIONS) - 2


def test_a_sweep_has_every_combination(client) -> None:
    body = {
        "name": "s",
        "config": {"task": "reaching"},
        "grid": {"alpha": [0.5, 0.9]},
        "seeds": [0, 1],
    }
    made = client.post("/api/v1/sweeps", json=body, headers={"Idempotency-Key": "s"}).json()
    assert len(made["run_ids"]) == 4
    assert made["states"] == {"queued": 4}
    runs = client.get(f"/api/v1/runs?sweep_id={made['id']}").json()["items"]
    assert {(run["config"]["alpha"], run["seed"]) for run in runs} == {
        (0.5, 0), (0.5, 1), (0.9, 0), (0.9, 1),
    }  # fmt: skip
    assert client.post("/api/v1/sweeps", json=body, headers={"Idempotency-Key": "s"}).json() == made
    for _ in range(2):
        client.post("/api/v1/sweeps", json=body | {"grid": {}, "seeds": [5]})
    first = client.get("/api/v1/sweeps?limit=2").json()
    rest = client.get("/api/v1/sweeps", params={"cursor": first["next_cursor"]}).json()
    assert [len(first["items"]), len(rest["items"]), rest["next_cursor"]] == [2, 1, None]
    stopped = client.post(f"/api/v1/sweeps/{made['id']}/stop").json()
    assert stopped["states"] == {"stopped": 4}
    twice = client.post("/api/v1/sweeps", json=body | {"grid": {"alpha": [0.5, 0.5]}})
    assert twice.status_code == 422


def test_audit_says_who_did_what(client, client_of) -> None:
    run = create(client_of("operator"))["id"]
    client.post(f"/api/v1/runs/{run}/stop")
    items = client.get(f"/api/v1/audit?subject={run}").json()["items"]
    assert [(item["action"], item["actor"]) for item in items] == [
        ("stop", "admin"), ("create", "operator"),
    ]  # fmt: skip


@given(
    value=st.one_of(st.none(), st.text(max_size=20), st.floats(allow_nan=False)),
    position=st.integers(0, 500),
    bit=st.integers(0, 7),
)
@settings(suppress_health_check=[HealthCheck.too_slow])
def test_an_altered_cursor_is_refused(value, position, bit) -> None:
    cursors = Cursors(b"k" * 32)
    cursor = cursors.encode([value, "id"], ["runs", "name"])
    assert cursors.decode(cursor, ["runs", "name"]) == [value, "id"]
    raw = bytearray(cursor.encode())
    raw[position % len(raw)] ^= 1 << bit
    altered = raw.decode("latin-1")
    for text, scope in ((altered, ["runs", "name"]), (cursor, ["runs", "-name"]), ("", ["runs"])):
        with contextlib.suppress(ApiError):
            decoded = cursors.decode(text, scope)
            assert decoded == [value, "id"]
            assert text[:-1] == cursor[:-1]  # base64's last character has bits that do not count


@pytest.mark.parametrize(
    "query",
    [
        "config.seed=" + "9" * 26, "config.seed=-1", "config.seed=1e400", "config.alpha=nan",
        "config.iterations=" + "9" * 300, "search=%00", "search=%ed%a0%80", "state=%00",
        "limit=" + "9" * 30, "cursor=AAAA", "config.seed=%D9%A3",
    ],
)  # fmt: skip
def test_no_query_is_a_fault_of_the_server(client, query) -> None:
    assert client.get(f"/api/v1/runs?{query}").status_code in (200, 422)
