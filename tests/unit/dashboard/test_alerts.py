"""What is worth an alert, told once, and delivered signed."""

import hashlib
import hmac
import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_dashboard.alerts.rules import FELL_BY, Standing, Trouble, fall, of_robots, of_runs
from bpn_dashboard.alerts.watch import AlertWatch
from bpn_dashboard.alerts.webhook import SIGNATURE, TRIES, Deliveries, Webhook, signature
from bpn_dashboard.database.engine import Database
from bpn_dashboard.hub.topology import Node, TopologySnapshot
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series import store as series_store
from bpn_dashboard.series.points import Points
from bpn_dashboard.series.query import SeriesQueries
from bpn_shared.counters import Counters
from bpn_shared.spec.config import ConfigError, RunConfig

CONFIG = RunConfig.for_task("reaching")
SECRET = b"a secret of some length"


@given(st.lists(st.floats(-100, 100), min_size=20, max_size=60), st.floats(0.1, 100))
def test_how_far_a_return_fell_depends_on_no_unit(returns: list[float], scale: float) -> None:
    learned = np.concatenate([np.full(5, -1000.0), np.array(returns)])
    lost = fall(learned)
    assert lost is not None
    assert lost >= 0
    assert fall(learned * scale) == pytest.approx(lost, abs=1e-6)
    assert fall(np.append(learned, [learned.max()] * 5)) == pytest.approx(0.0, abs=1e-9)
    assert fall(np.append(learned, [-1000.0] * 5)) >= 1.0 - 1e-9


def test_a_return_that_never_rose_or_is_not_known_yet_did_not_fall() -> None:
    assert fall(np.full(100, -5.0)) is None
    assert fall(np.linspace(0.0, -100.0, 100)) is None
    assert fall(np.full(100, np.nan)) is None
    assert fall(np.array([0.0] * 5 + [10.0] * 5 + [0.0] * 5)) is None  # too few to tell
    rising = np.linspace(-100.0, 0.0, 50)
    assert fall(rising) == 0.0
    assert fall(np.append(rising, [-80.0] * 5)) > FELL_BY


def test_a_trouble_is_told_when_it_begins_and_when_it_comes_back() -> None:
    trouble = Trouble("failed", "run", "run", "it failed")
    other = Trouble("stalled", "run", "run", "it stands")
    standing = Standing([("failed", "run"), ("stalled", "another")])
    assert standing.news([trouble]) == []  # told in an earlier life
    assert standing.news([trouble, other]) == [other]
    assert standing.news([trouble, other]) == []
    assert standing.news([]) == []
    assert standing.news([trouble]) == [trouble]


def node(run: str, age_s: float, **values: Any) -> Node:
    return Node(
        kind="robot_sim",
        id="robot-1",
        state="stale",
        age_s=age_s,
        run=run,
        slot=0,
        host="h",
        **values,
    )


def test_runs_and_robots_are_watched(database: Database, store: RunStore) -> None:
    nodes: list[Node] = []
    told: list[Any] = []
    watch = AlertWatch(
        database, store, SeriesQueries(database),
        lambda: TopologySnapshot(time_unix_s=0.0, nodes=nodes, links=[]), [told.append],
    )  # fmt: skip
    now_s = time.time()
    assert watch.look(now_s) == []
    run = store.create(CONFIG, name="mine", actor="a")
    store.observe({run.id: {"state": "running"}})
    assert watch.look(now_s) == []
    nodes.append(node(run.id, age_s=5.0))  # slow, not silent
    assert watch.look(now_s) == []
    nodes[0] = node(run.id, age_s=30.0)
    store.observe({run.id: {"waiting_reason": "1 edge missing", "waiting_since": now_s - 90.0}})
    kinds = {alert["kind"]: alert["text"] for alert in watch.look(now_s)}
    assert kinds == {
        "stalled": "mine makes no progress for 90 s: 1 edge missing",
        "robot_stale": "robot 0 of mine says nothing for 30 s (robot-1 on h)",
    }
    assert watch.look(now_s) == []
    store.observe({run.id: {"state": "failed", "error": "Traceback:\n  x\nConfigError: no GPU"}})
    [failed] = watch.look(now_s)
    assert (failed["kind"], failed["run"]) == ("failed", run.id)
    assert failed["text"] == "mine failed: ConfigError: no GPU"
    assert [alert["kind"] for alert in told][-1] == "failed"


def test_a_fallen_return_is_told_once(database: Database, store: RunStore) -> None:
    watch = AlertWatch(
        database,
        store,
        SeriesQueries(database),
        lambda: TopologySnapshot(time_unix_s=0.0, nodes=[], links=[]),
        [],
    )
    run = store.create(CONFIG, name="mine", actor="a")
    values = [*np.linspace(-400.0, -100.0, 40), *[-390.0] * 6]

    def learned(n: int, at_s: float) -> list[str]:
        with database.writing() as session:
            series_store.append(
                session, run.id, {"return_px": Points.written(range(n), values[:n])}
            )
        store.observe({run.id: {"state": "running", "iteration": n}})
        return [alert["kind"] for alert in watch.look(at_s)]

    assert learned(40, 1000.0) == []
    assert learned(46, 1010.0) == []  # looked at now and then
    assert learned(46, 1050.0) == ["return_fell"]
    assert learned(46, 1100.0) == []


def test_who_does_not_serve_tells_nothing(database: Database, store: RunStore, client) -> None:
    serving = [False]
    watch = AlertWatch(
        database, store, SeriesQueries(database),
        lambda: TopologySnapshot(time_unix_s=0.0, nodes=[], links=[]), [], serving=lambda: serving[0],
    )  # fmt: skip
    watch.look()
    runs = [store.create(CONFIG, actor="a") for _ in range(2)]
    store.observe({runs[0].id: {"state": "failed", "error": "x"}})
    assert watch.look() == []
    serving[0] = True
    store.observe({runs[1].id: {"state": "failed", "error": "x"}})
    assert [alert["run"] for alert in watch.look()] == [runs[1].id]
    listed = client.get("/api/v1/alerts").json()
    assert [(item["kind"], item["run"]) for item in listed["items"]] == [("failed", runs[1].id)]
    assert (listed["webhook"], listed["webhook_trouble"]) == (False, "")


def test_what_happened_while_nobody_looked_is_told_and_the_past_is_not(
    database: Database, store: RunStore
) -> None:
    """Another life of the dashboard tells what is new, once; not of runs that failed long ago."""
    runs = [store.create(CONFIG, actor="a") for _ in range(2)]
    for run in runs:
        store.observe({run.id: {"state": "failed", "error": "x"}})

    def look(now_s: float) -> list[str]:
        watch = AlertWatch(
            database, store, SeriesQueries(database),
            lambda: TopologySnapshot(time_unix_s=0.0, nodes=[], links=[]), [],
        )  # fmt: skip
        return sorted(alert["run"] for alert in watch.look(now_s))

    assert look(time.time() + 3600.0) == []
    assert look(time.time()) == sorted(run.id for run in runs)
    assert look(time.time()) == []


def test_an_old_failure_is_no_news_where_its_run_is_tagged(
    database: Database, store: RunStore
) -> None:
    run = store.create(CONFIG, actor="a")
    store.observe({run.id: {"state": "failed", "error": "x"}})
    watch = AlertWatch(
        database, store, SeriesQueries(database),
        lambda: TopologySnapshot(time_unix_s=0.0, nodes=[], links=[]), [],
    )  # fmt: skip
    assert watch.look(time.time() + 3600.0) == []
    store.edit(run.id, "tag", "a", lambda _row: {"tags": ["seen"]})
    assert watch.look(time.time()) == []


def test_what_is_queued_or_over_is_no_stall(store: RunStore) -> None:
    run = store.create(CONFIG, actor="a")
    store.observe({run.id: {"waiting_reason": "waits for a learner", "waiting_since": 1.0}})
    assert list(of_runs([store.get(run.id)], time.time())) == []
    store.observe({run.id: {"state": "stopped"}})
    assert list(of_robots([node(run.id, 99.0)], [store.get(run.id)])) == []


class Receiver(BaseHTTPRequestHandler):
    """Answers with the statuses that its server still has, then with 204."""

    server: Any

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.got.append((self.path, self.headers[SIGNATURE], body))
        status = self.server.statuses.pop(0) if self.server.statuses else 204
        self.send_response(status)
        if 300 <= status < 400:
            self.send_header("Location", "/elsewhere")
        self.end_headers()

    def log_message(self, *_arguments: Any) -> None:
        pass


@pytest.fixture
def receiver() -> Iterator[Any]:
    server: Any = HTTPServer(("127.0.0.1", 0), Receiver)
    server.got, server.statuses = [], []
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join(10.0)


def deliver(url: str, alerts: list[dict[str, Any]], done: Any) -> tuple[Deliveries, Counters]:
    counters, stop = Counters(), threading.Event()
    deliveries = Deliveries(Webhook(url, SECRET), counters, stop, first_s=0.01)
    thread = threading.Thread(target=deliveries.follow, daemon=True)
    thread.start()
    for alert in alerts:
        deliveries.put(alert)
    deadline_s = time.monotonic() + 20.0
    while not done(counters.snapshot()) and time.monotonic() < deadline_s:
        stop.wait(0.01)
    stop.set()
    thread.join(10.0)
    assert done(counters.snapshot())
    return deliveries, counters


def test_alerts_are_sent_signed_and_again_where_it_may_help(receiver) -> None:
    receiver.statuses = [500, 429]
    url = f"http://127.0.0.1:{receiver.server_port}/hook"
    alerts = [{"id": 1, "text": "größe"}, {"id": 2, "text": "y"}]
    deliveries, _ = deliver(url, alerts, lambda counts: counts.get("alerts_sent") == 2)
    assert deliveries.trouble == ""
    assert [json.loads(body)["id"] for _, _, body in receiver.got] == [1, 1, 1, 2]
    for _, signed, body in receiver.got:
        at_s, digest = (part.split("=")[1] for part in signed.split(","))
        expected = hmac.new(SECRET, f"{at_s}.".encode() + body, hashlib.sha256).hexdigest()
        assert hmac.compare_digest(digest, expected)
        assert abs(time.time() - int(at_s)) < 60
    assert signature(b"other", 1, b"x") != signature(SECRET, 1, b"x") != signature(SECRET, 2, b"x")


@pytest.mark.parametrize(
    ("statuses", "tries", "said"),
    [
        ([404], 1, "refuses it (404)"),
        ([302], 1, "redirects, which is not followed (302)"),
        ([500] * TRIES, TRIES, f"(500), after {TRIES} tries"),
    ],
)
def test_no_alert_is_tried_for_ever_or_elsewhere(receiver, statuses, tries, said) -> None:
    receiver.statuses = list(statuses)
    url = f"http://127.0.0.1:{receiver.server_port}/hook"
    deliveries, _ = deliver(url, [{"id": 1}], lambda counts: counts.get("alerts_not_sent") == 1)
    assert said in deliveries.trouble
    assert [path for path, _, _ in receiver.got] == ["/hook"] * tries


def test_a_name_that_is_none_does_not_end_the_sending() -> None:
    url = f"http://{'a' * 70}.example/"
    alerts = [{"id": 1}, {"id": 2}]
    deliveries, _ = deliver(url, alerts, lambda counts: counts.get("alerts_not_sent") == 2)
    assert "cannot be reached" in deliveries.trouble


def test_an_address_or_secret_that_is_none_is_refused(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(SECRET + b"\n")
    assert Webhook.read("https://example.org/hook", secret) == Webhook(
        "https://example.org/hook", SECRET
    )
    for url in (
        "file:///etc/passwd", "example.org", "https://me@example.org", "http://", "http://[::1/hook",
        "http://example.org:port/", "http://example.org/h\u00f6ren", "http://example.org/a b",
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="--alert-webhook"):
            Webhook.read(url, secret)
    with pytest.raises(ConfigError, match="--alert-secret"):
        Webhook.read("https://example.org", tmp_path / "none")
    secret.write_bytes(b"short")
    with pytest.raises(ConfigError, match="16 bytes or more"):
        Webhook.read("https://example.org", secret)
