"""The REST part of `bpn bench dashboard`: long series drawn, lines taken in, many runs listed.

A dashboard of its own process answers over loopback; times are those of whole requests. `cold` is a view that
was never asked for, with the database's pages already read; `warm` the same view again.
"""

import contextlib
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import httpx
import numpy as np

from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series import store
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.series.points import Points
from bpn_dashboard.service import ADDRESS_FILE
from bpn_shared.config import RunConfig
from bpn_shared.run_folder import RunFolder
from bpn_shared.service import Counters

RUNS, POINTS, SEEDS = 100, 100_000, 10
LISTED = 10_000
LINES, METRICS = 20_000, 18
REPEATS = 9
_DATABASE = ".dashboard.sqlite"
_START_S = 60.0
_METRIC = "return_px"

TARGETS = {
    "group_cold_ms": 600.0,
    "group_warm_ms": 150.0,
    "zoom_ms": 200.0,
    "list_ms": 300.0,
    "filter_ms": 300.0,
    "sort_ms": 300.0,
    "points_per_s": 50_000.0,
    "bytes_per_point": 20.0,
}
"""Upper bounds but for points_per_s, which is the least."""


def measure() -> dict[str, float]:
    """All of `TARGETS`, times as medians of repeated requests."""
    with tempfile.TemporaryDirectory(prefix="bpn-bench-") as directory:
        series = _measure_series(Path(directory) / "series")
        lists = _measure_lists(Path(directory) / "lists")
        ingest = _measure_ingest(Path(directory) / "ingest")
    return series | lists | ingest


def met(result: dict[str, float]) -> bool:
    """Whether every figure reaches its target."""
    slow = [
        name for name, most in TARGETS.items() if name != "points_per_s" and result[name] > most
    ]
    return not slow and result["points_per_s"] >= TARGETS["points_per_s"]


def _measure_series(runs_dir: Path) -> dict[str, float]:
    rng = np.random.default_rng(0)
    database = Database(sqlite_url(runs_dir / _DATABASE))
    runs = RunStore(database, runs_dir)
    steps = np.arange(POINTS)
    for index in range(RUNS):
        alpha = (index // SEEDS) / 10
        config = RunConfig.for_task("reaching", seed=index % SEEDS, alpha=alpha, iterations=POINTS)
        run = runs.create(config, actor="bench")
        with database.writing() as session:
            points = Points(steps, rng.normal(size=POINTS).cumsum())
            store.append(session, run.id, {_METRIC: points})
    database.close()
    stored = (runs_dir / _DATABASE).stat().st_size / (RUNS * POINTS)
    body = {"filter": {}, "group_by": "all_but_seed", "metrics": [_METRIC], "band": "ci95"}
    with _dashboard(runs_dir) as client:
        views = itertools.count(1000)
        cold = [body | {"max_points": next(views)} for _ in range(REPEATS)]
        zooms = [body | {"range": [1000 * i, 1000 * i + 15_000]} for i in range(1, REPEATS + 1)]
        return {
            "group_cold_ms": _post_ms(client, cold),
            "group_warm_ms": _post_ms(client, cold),
            "zoom_ms": _post_ms(client, zooms),
            "bytes_per_point": round(stored, 1),
        }


def _measure_lists(runs_dir: Path) -> dict[str, float]:
    for index in range(LISTED):
        config = RunConfig.for_task("reaching", seed=index, alpha=(index % 100) / 100)
        RunFolder.create(runs_dir, UUID(int=uuid4().int), config)
    with _dashboard(runs_dir) as client:
        return {
            "list_ms": _get_ms(client, {"limit": "200"}),
            "filter_ms": _get_ms(client, {"limit": "200", "config.alpha": "0.5", "search": "seed"}),
            "sort_ms": _get_ms(client, {"limit": "200", "sort": "-name"}),
        }


def _measure_ingest(runs_dir: Path) -> dict[str, float]:
    folder = runs_dir / str(uuid4())
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    with (folder / "metrics.jsonl").open("w") as file:
        for iteration, values in enumerate(rng.normal(size=(LINES, METRICS)).tolist()):
            record = {f"metric_{index}": value for index, value in enumerate(values)}
            file.write(json.dumps({"iteration": iteration, **record}) + "\n")
    database = Database(sqlite_url(runs_dir / _DATABASE))
    ingest = Ingest(runs_dir, database, Counters())
    start_s = time.perf_counter()
    points = ingest.poll()
    seconds = time.perf_counter() - start_s
    database.close()
    return {"points_per_s": round(points / seconds)}


@contextlib.contextmanager
def _dashboard(runs_dir: Path) -> Iterator[httpx.Client]:
    """A dashboard on these runs, without a message bus, once it has indexed them."""
    command = [sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(runs_dir), "--port", "0"]
    with subprocess.Popen(  # noqa: S603 - ours
        [*command, "--connect", f"unixsock-stream/{runs_dir}/none"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    ) as process:
        try:
            yield _client(runs_dir / ADDRESS_FILE)
        finally:
            process.terminate()


def _client(address_file: Path) -> httpx.Client:
    deadline_s = time.monotonic() + _START_S
    while time.monotonic() < deadline_s:
        with contextlib.suppress(OSError, ValueError, httpx.HTTPError):
            address = json.loads(address_file.read_bytes())
            headers = {"Authorization": f"Bearer {address['token']}"}
            client = httpx.Client(base_url=address["url"], headers=headers, timeout=60)
            client.get("/readyz").raise_for_status()
            return client
        time.sleep(0.1)
    raise TimeoutError(f"the dashboard was not ready within {_START_S:.0f} s")


def _post_ms(client: httpx.Client, bodies: list[dict[str, Any]]) -> float:
    headers = {"Accept": "application/vnd.bpn.series"}
    return _median_ms(
        lambda body: client.post("/api/v1/series/query", json=body, headers=headers), bodies
    )


def _get_ms(client: httpx.Client, query: dict[str, str]) -> float:
    return _median_ms(lambda _: client.get("/api/v1/runs", params=query), range(REPEATS))


def _median_ms(call: Any, arguments: Any) -> float:
    times_s = []
    for argument in arguments:
        start_s = time.perf_counter()
        call(argument).raise_for_status()
        times_s.append(time.perf_counter() - start_s)
    return round(1e3 * statistics.median(times_s), 1)
