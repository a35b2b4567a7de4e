import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bpn_dashboard.api.records import record_of
from bpn_dashboard.database.engine import Database
from bpn_dashboard.registry.progress import Progress
from bpn_dashboard.series import store
from bpn_dashboard.series.ingest import Ingest
from bpn_dashboard.series.lines import parse_lines
from bpn_dashboard.series.points import Points
from bpn_dashboard.series.query import Series, SeriesQueries, View
from bpn_shared.counters import Counters
from bpn_shared.runs.digests import seal_line
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

RUN = "01a201f9-821b-74c6-95eb-3f4ab1331c4c"
CONFIG = RunConfig.for_task("reaching")


@pytest.fixture
def runs(tmp_path: Path, database: Database):
    """A runs folder with what one needs to write to it and take it in."""
    folder = tmp_path / "runs" / RUN
    folder.mkdir(parents=True)
    file = folder / "metrics.jsonl"

    def write(*records: dict[str, Any]) -> None:
        with file.open("a") as lines:
            lines.writelines(json.dumps(record) + "\n" for record in records)

    def ingest() -> Ingest:
        return Ingest(tmp_path / "runs", database, counters)

    counters = Counters()
    return SimpleNamespace(file=file, write=write, ingest=ingest, counters=counters)


def query(database: Database, runs: list[str], metric: str, view: View) -> Series:
    of_seeds = {run: place for place, run in enumerate(sorted(runs))}
    return SeriesQueries(database).query([of_seeds], [metric], view)[0]


def stored(database: Database, name: str, run: str = RUN) -> tuple[list[int], list[float]]:
    with database.reading() as session:
        rows = store.metrics_of(session, [run], [name])
        if not rows:
            return [], []
        points = store.read_points(session, [rows[0].id], 0, 2**53)[rows[0].id]
        assert rows[0].n == len(points.steps)
        assert (rows[0].first, rows[0].last) == (points.steps[0], points.steps[-1])
        return points.steps.tolist(), points.values.tolist()


@given(st.data())
def test_a_line_that_was_changed_since_it_was_written_is_no_data_for_any_reader(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Oracle: every reader says what it said of the file without that line."""
    written = [
        {"iteration": n, "weights_version": n, "length": 1.5, "return_px": -20.5 - n}
        for n in range(3)
    ]
    lines = [seal_line(record) for record in written]
    at = data.draw(st.integers(0, len(lines[1]) - len(b', "sha256": "0123456789abcdef"}') - 1))
    damaged = bytearray(lines[1])
    damaged[at] ^= 1 << data.draw(st.integers(0, 7))
    damaged = bytes(damaged).replace(b"\n", b" ")

    def read(*lines: bytes) -> list[Any]:
        folder = RunFolder.create(tmp_path_factory.mktemp("runs"), RUN, CONFIG)
        content = b"".join(line + b"\n" for line in lines)
        folder.write("metrics.jsonl", content)
        points = {
            name: (p.steps.tolist(), p.values.tolist())
            for name, p in parse_lines(content)[0].items()
        }
        records = [record_of(folder, "metrics.jsonl", iteration) for iteration in range(3)]
        return [points, Progress(folder).read(), records]

    assert read(lines[0], damaged, lines[2]) == read(lines[0], lines[2])
    assert read(lines[0], damaged) == read(lines[0])
    assert len(parse_lines(damaged)[1]) == 1


@given(
    batches=st.lists(
        st.lists(st.tuples(st.integers(0, 20_000), st.floats(-10, 10)), min_size=1, max_size=20),
        min_size=1,
        max_size=5,
    )
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # each has a run of its own
def test_the_later_of_two_points_at_an_iteration_counts(database, batches) -> None:
    """Oracle: a dict. The rollups must agree with the points that they stand for."""
    run = str(uuid4())
    expected: dict[int, float] = {}
    for batch in batches:
        expected |= dict(batch)
        steps, values = zip(*batch, strict=True)
        with database.writing() as session:
            store.append(session, run, {"loss": Points.written(steps, values)})
    assert stored(database, "loss", run) == (
        sorted(expected),
        [expected[i] for i in sorted(expected)],
    )
    with database.reading() as session:
        metric = store.metrics_of(session, [run])[0].id
        rollups = store.read_rollups(session, [metric], 0, 2**53)[metric]
    for begin, low, high, n in zip(rollups.x, rollups.min, rollups.max, rollups.n, strict=True):
        inside = [v for i, v in expected.items() if begin <= i < begin + store.ROLLUP]
        assert (low, high, n) == (min(inside), max(inside), len(inside))


def test_lines_become_series_with_nested_names() -> None:
    record = {
        "iteration": 3, "attempt": 1, "loss": 0.5, "failures": 2, "ok": True, "gap": None,
        "returns_px": [1.0], "weights_sha256": "ab", "edge": {"inference_us": {"p50": 5.5}},
    }  # fmt: skip
    columns, errors = parse_lines(json.dumps(record).encode() + b"\nnonsense\n[1]\n")
    assert sorted(columns) == ["attempt", "edge.inference_us.p50", "failures", "gap", "loss", "ok"]
    assert columns["edge.inference_us.p50"].steps.tolist() == [3]
    assert np.isnan(columns["gap"].values[0])
    assert len(errors) == 2


def test_lines_are_taken_in_once_and_only_when_whole(database, runs) -> None:
    ingest = runs.ingest()
    runs.write({"iteration": 0, "loss": 1.0}, {"iteration": 1, "loss": 2.0})
    with runs.file.open("a") as lines:
        lines.write('{"iteration": 2, "lo')
    assert ingest.poll() == 2
    with runs.file.open("a") as lines:
        lines.write('ss": 3.0}\n')
    assert ingest.poll() == 1
    assert ingest.poll() == 0
    assert stored(database, "loss") == ([0, 1, 2], [1.0, 2.0, 3.0])


def test_a_line_that_a_crash_cut_is_counted_and_its_repetition_taken(database, runs) -> None:
    with runs.file.open("a") as lines:
        lines.write('{"iteration": 0, "loss": 1.0}\n{"iteration": 1, "lo\n')
    runs.write({"iteration": 1, "loss": 2.5})
    runs.ingest().poll()
    assert stored(database, "loss") == ([0, 1], [1.0, 2.5])
    assert runs.counters.snapshot()["metrics_lines_refused"] == 1


def test_another_process_goes_on_at_the_same_byte(database, runs) -> None:
    runs.write({"iteration": 0, "loss": 1.0})
    runs.ingest().poll()
    runs.write({"iteration": 1, "loss": 2.0})
    assert runs.ingest().poll() == 1
    assert stored(database, "loss") == ([0, 1], [1.0, 2.0])


def test_a_replaced_file_is_read_from_the_start(database, runs) -> None:
    runs.write({"iteration": 0, "loss": 1.0}, {"iteration": 1, "loss": 2.0, "old": 1.0})
    runs.ingest().poll()
    other = runs.file.with_name("other")
    other.write_text('{"iteration": 0, "loss": 7.0}\n')
    os.replace(other, runs.file)
    runs.ingest().poll()
    assert stored(database, "loss") == ([0], [7.0])
    assert stored(database, "old") == ([], [])


def test_few_points_are_shown_as_they_are_and_many_in_buckets(database) -> None:
    rng = np.random.default_rng(1)
    losses = rng.normal(size=10_000)
    losses[4321] = 50.0
    with database.writing() as session:
        store.append(session, RUN, {"loss": Points.written(range(10_000), losses.tolist())})
    few = query(database, [RUN], "loss", View(range=(4000, 4099), max_points=100))
    many = query(database, [RUN], "loss", View(max_points=100))
    middle = query(database, [RUN], "loss", View(range=(3000, 5999), max_points=100))
    assert few.bucket == 0
    np.testing.assert_array_equal(few.curve.value, losses[4000:4100])
    assert many.bucket == 128
    assert many.n_points == 10_000
    assert many.curve.max.max() == 50.0
    np.testing.assert_allclose(many.curve.value[3], losses[384:512].mean(), rtol=1e-9)
    assert middle.bucket == 32  # finer than the rollups
    np.testing.assert_allclose(middle.curve.value[0], losses[2976:3008].mean(), rtol=1e-9)


def test_a_sparse_metric_is_not_bucketed(database) -> None:
    sparse = range(0, 100_000, 5_000)
    with database.writing() as session:
        store.append(session, RUN, {"exam": Points.written(sparse, [float(i) for i in sparse])})
    series = query(database, [RUN], "exam", View(max_points=50))
    assert series.bucket == 0
    assert series.curve.x.tolist() == list(sparse)


@pytest.mark.parametrize(
    ("axis", "x", "inside"),
    [
        ("wall_s", [2, 5, 12], [5, 6, 7]),
        ("process_s", [2, 5, 6], [5, 6, 7]),
        ("transitions", [200, 400, 500], [5, 6]),
    ],
)
def test_other_axes_place_points_by_their_iteration(database, axis, x, inside) -> None:
    """The first iteration took time, too; and a pause is none of the time that a run was worked on."""
    columns = {
        "loss": Points.written([0, 1, 2], [5.0, 6.0, 7.0]),
        "time_unix_s": Points.written([0, 1, 2], [100.0, 103.0, 110.0]),
        "iteration_s": Points.written([0, 1, 2], [2.0, 3.0, 1.0]),
        "transitions": Points.written([0, 1, 2], [200.0, 200.0, 100.0]),
    }
    with database.writing() as session:
        store.append(session, RUN, columns)
    curve = query(database, [RUN], "loss", View(axis=axis)).curve
    part = query(database, [RUN], "loss", View(axis=axis, range=(2, 450))).curve
    assert curve.x.tolist() == x
    assert curve.value.tolist() == [5, 6, 7]
    assert part.value.tolist() == inside


def test_a_clock_that_was_set_back_loses_no_point(database) -> None:
    """An hour back at iteration 50: what comes then took as long as it says, and nothing stands upon another."""
    n = 100
    times = [1e9 + 10.0 * i - (3600.0 if i >= 50 else 0.0) for i in range(n)]
    values = [float((7 * i) % n) for i in range(n)]
    with database.writing() as session:
        store.append(
            session,
            RUN,
            {
                "loss": Points.written(range(n), values),
                "time_unix_s": Points.written(range(n), times),
                "iteration_s": Points.written(range(n), [10.0] * n),
            },
        )
    series = query(database, [RUN], "loss", View(axis="wall_s"))
    assert series.curve.x.tolist() == [10.0 * (i + 1) for i in range(n)]
    assert series.curve.value.tolist() == values
    # Where no iteration says how long it took, points share a place, and none of their extremes is lost.
    with database.writing() as session:
        store.forget(session, RUN)
        store.append(
            session,
            RUN,
            {
                "loss": Points.written(range(n), values),
                "time_unix_s": Points.written(range(n), times),
            },
        )
    series = query(database, [RUN], "loss", View(axis="wall_s"))
    assert (series.n_points, series.curve.min.min(), series.curve.max.max()) == (n, 0.0, n - 1.0)


@pytest.mark.parametrize("max_points", [1000, 10])
def test_a_hole_in_a_series_is_seen_as_one(database, max_points: int) -> None:
    values = [float("nan") if 400 <= i < 700 else 1.0 for i in range(1000)]
    other = RUN.replace("0", "1")
    with database.writing() as session:
        for run in (RUN, other):
            store.append(session, run, {"loss": Points.written(range(1000), values)})
    for runs in ([RUN], [RUN, other]):
        curve = query(database, runs, "loss", View(max_points=max_points)).curve
        inside = (curve.x >= 400) & (curve.x < 576)  # a whole bucket, however wide
        assert inside.any()
        assert np.isnan(curve.value[inside]).all()
        assert np.isnan(curve.last[inside]).all()
        assert (curve.n[inside] == 0).all()
        assert curve.value[-1] == 1.0


def test_groups_do_not_depend_on_order_or_on_who_has_no_points(database) -> None:
    other = RUN.replace("0", "1")
    with database.writing() as session:
        store.append(session, RUN, {"loss": Points.written([0, 1], [1.0, 2.0])})
        store.append(session, other, {"loss": Points.written([0, 1], [3.0, 6.0])})
    one = query(database, [RUN, other], "loss", View())
    two = query(database, [other, RUN, "no such run"], "loss", View())
    assert one.curve.value.tolist() == two.curve.value.tolist() == [2.0, 4.0]
    assert one.run_ids == two.run_ids == sorted([RUN, other])
