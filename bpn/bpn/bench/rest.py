"""The REST part of `bpn bench dashboard`: long series drawn, lines taken in, many runs listed.

Times are those of whole requests over loopback. `cold` is a view that was never asked for, with the
database's pages already read; `warm` the same view again.
"""

import itertools
import json
import statistics
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import numpy as np

from bpn.bench.figures import Figure, results
from bpn.bench.served import Served
from bpn.bench.sizes import Sizes
from bpn_dashboard.database.engine import Database, sqlite_url
from bpn_dashboard.registry.store import RunStore
from bpn_dashboard.series import store
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.series.points import Points
from bpn_shared.counters import Counters
from bpn_shared.runs.folder import RunState
from bpn_shared.spec.config import RunConfig

METRIC = "return_px"
TASK = "reaching"
_METRICS = 18
_DATABASE = ".dashboard.sqlite"

SERIES = (
    Figure("group_cold_ms", "groups with bands, first view, answered, ms", 600.0),
    Figure("group_warm_ms", "  the same view again, ms", 150.0),
    Figure("zoom_ms", "  zoom to another range, answered, ms", 200.0),
    Figure("bytes_per_point", "  bytes stored for a point", 20.0),
)
LISTS = (
    Figure("list_ms", "first page of the runs, answered, ms", 300.0),
    Figure("filter_ms", "  filtered, ms", 300.0),
    Figure("sort_ms", "  sorted, ms", 300.0),
)
INGEST = (Figure("points_per_s", "points taken in, 1/s", 50_000.0, "least", digits=0),)


def make_series(runs_dir: Path, sizes: Sizes) -> float:
    """Finished runs with long series of one metric, in groups of seeds; returns bytes per point."""
    rng = np.random.default_rng(0)
    database = Database(sqlite_url(runs_dir / _DATABASE))
    runs = RunStore(database, runs_dir)
    steps = np.arange(sizes.points)
    for index in range(sizes.runs):
        config = RunConfig.for_task(
            TASK,
            seed=index % sizes.seeds,
            alpha=(index // sizes.seeds) / 10,
            iterations=sizes.points,
        )
        run = runs.create(config, actor="bench")
        runs.folder(run.id).set_state("finished")
        with database.writing() as session:
            points = Points(steps, rng.normal(size=sizes.points).cumsum())
            store.append(session, run.id, {METRIC: points})
    database.close()
    return (runs_dir / _DATABASE).stat().st_size / (sizes.runs * sizes.points)


def measure_series(
    served: Served, sizes: Sizes, bytes_per_point: float
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Figures of `SERIES`, and their samples."""
    body = {"filter": {}, "group_by": "all_but_seed", "metrics": [METRIC], "band": "ci95"}
    views = itertools.count(1000)
    cold = [body | {"max_points": next(views)} for _ in range(sizes.repeats)]
    begins = np.linspace(0, 0.8 * sizes.points, sizes.repeats).astype(int).tolist()
    zooms = [body | {"range": [begin, begin + 0.15 * sizes.points]} for begin in begins]
    samples = {
        "group_cold_ms": _post_ms(served.http, cold),
        "group_warm_ms": _post_ms(served.http, cold),
        "zoom_ms": _post_ms(served.http, zooms),
        "bytes_per_point": [bytes_per_point],
    }
    return results(SERIES, medians(samples)), samples


def make_lists(runs_dir: Path, sizes: Sizes) -> None:
    """Finished runs of one iteration. Written plainly: `RunFolder` waits for the disk at every file."""
    rng = np.random.default_rng(0)
    for index, value in enumerate(rng.normal(-100, 20, sizes.listed).tolist()):
        config = RunConfig.for_task(TASK, seed=index, alpha=(index % 100) / 100)
        now_s = time.time()
        state = RunState(state="finished", created_unix_s=now_s, updated_unix_s=now_s)
        record = {"iteration": 0, METRIC: value, "length": 20.0, "weights_version": 1}
        folder = runs_dir / str(uuid4())
        folder.mkdir()
        (folder / "config.json").write_text(config.model_dump_json())
        (folder / "metrics.jsonl").write_text(json.dumps(record) + "\n")
        (folder / "state.json").write_text(state.model_dump_json())
    # Now, so that the server that is measured is at rest: it would read all of them first.
    database = Database(sqlite_url(runs_dir / _DATABASE))
    RunStore(database, runs_dir).adopt()
    Ingest(runs_dir, database, Counters()).poll()
    database.close()


def measure_lists(served: Served, sizes: Sizes) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Figures of `LISTS`, and their samples."""

    def get_ms(query: dict[str, str]) -> list[float]:
        call = lambda _: served.http.get("/api/v1/runs", params={"limit": "200"} | query)  # noqa: E731
        return _times_ms(call, range(sizes.repeats))

    samples = {
        "list_ms": get_ms({}),
        "filter_ms": get_ms({"config.alpha": "0.5", "search": "seed"}),
        "sort_ms": get_ms({"sort": "-return_best"}),
    }
    return results(LISTS, medians(samples)), samples


def measure_ingest(runs_dir: Path, sizes: Sizes) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Figures of `INGEST`: a file of many lines from the start."""
    folder = runs_dir / str(uuid4())
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    with (folder / "metrics.jsonl").open("w") as file:
        for iteration, values in enumerate(rng.normal(size=(sizes.lines, _METRICS)).tolist()):
            record = {f"metric_{index}": value for index, value in enumerate(values)}
            file.write(json.dumps({"iteration": iteration, **record}) + "\n")
    database = Database(sqlite_url(runs_dir / _DATABASE))
    ingest = Ingest(runs_dir, database, Counters())
    start_s = time.perf_counter()
    points = ingest.poll()
    seconds = time.perf_counter() - start_s
    database.close()
    samples = {"points_per_s": [points / seconds]}
    return results(INGEST, medians(samples)), samples


def medians(samples: dict[str, list[float]]) -> dict[str, float]:
    """The median of each."""
    return {name: statistics.median(values) for name, values in samples.items()}


def _post_ms(client: httpx.Client, bodies: list[dict[str, Any]]) -> list[float]:
    headers = {"Accept": "application/vnd.bpn.series"}
    return _times_ms(
        lambda body: client.post("/api/v1/series/query", json=body, headers=headers), bodies
    )


def _times_ms(call: Callable[[Any], httpx.Response], arguments: Iterable[Any]) -> list[float]:
    times_ms = []
    for argument in arguments:
        start_s = time.perf_counter()
        call(argument).raise_for_status()
        times_ms.append(round(1e3 * (time.perf_counter() - start_s), 1))
    return times_ms
