"""Sweeps, and heat maps of any two keys."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from bpn_dashboard.api.configs import ConfigKey
from bpn_dashboard.api.context import Context, Operator, Parts, Viewer
from bpn_dashboard.api.filters import RunFilterQuery
from bpn_dashboard.api.idempotency import IdempotencyKey, once
from bpn_dashboard.api.models import MetricName, Sweep, SweepNew
from bpn_dashboard.api.problems import responses
from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.series.summary import Value
from bpn_shared.runs.statistics import over_seeds
from bpn_shared.spec.tasks import RETURN

router = APIRouter(tags=["sweeps"])


class SweepPage(BaseModel):
    """Some of the sweeps, newest first."""

    items: list[Sweep]
    next_cursor: str | None


class SweepListQuery(BaseModel):
    """Which page."""

    model_config = {"extra": "forbid"}

    cursor: Annotated[str | None, Field(max_length=1000)] = None
    limit: Annotated[int, Field(ge=1, le=200)] = 50


class HeatmapAxis(BaseModel):
    """A configuration key and the values that runs have of it, in order."""

    key: str
    values: list[Any]


class HeatmapCell(BaseModel):
    """The runs with these two values, those of one seed averaged first; `std` is the sample's, null of one."""

    x: Any
    y: Any
    n: Annotated[int, Field(description="seeds")]
    mean: float
    std: float | None
    run_ids: list[str]


class Heatmap(BaseModel):
    """Cells that have runs with the metric; the others are left out."""

    x: HeatmapAxis
    y: HeatmapAxis
    metric: str
    value: str
    cells: list[HeatmapCell]


class _Axes(BaseModel):
    x: ConfigKey
    y: ConfigKey
    metric: Annotated[
        MetricName | None, Field(description="null: the return, as the runs' task has it")
    ] = None
    value: Annotated[
        Literal["best_mean", "last_mean"],
        Field(description="mean over seeds of each run's largest, or newest, value"),
    ] = "last_mean"


class HeatmapOfSweepQuery(_Axes):
    """What the map shows."""

    model_config = {"extra": "forbid"}


class HeatmapQuery(RunFilterQuery, _Axes):
    """Of which runs, and what the map shows."""


@router.get("/sweeps", operation_id="listSweeps", responses=responses(422))
def list_sweeps(_who: Viewer, parts: Parts, query: Annotated[SweepListQuery, Query()]) -> SweepPage:
    """A page of sweeps."""
    after = query.cursor and parts.cursors.decode(query.cursor, "sweeps")
    rows = parts.runs.page_sweeps(after=after, limit=query.limit + 1)
    more, rows = len(rows) > query.limit, rows[: query.limit]
    following = parts.cursors.encode(rows[-1].id, "sweeps") if more else None
    return SweepPage(items=_shown(parts, rows), next_cursor=following)


@router.post(
    "/sweeps", operation_id="createSweep", status_code=201, responses=responses(409, 422, 507)
)
def create_sweep(
    who: Operator, parts: Parts, response: Response, body: SweepNew, key: IdempotencyKey = None
) -> Sweep:
    """Puts a run for every point of the grid and every seed into the queue."""

    def create() -> str:
        config = body.config.model_dump(exclude_unset=True)
        grid = body.grid.model_dump(exclude_unset=True)
        sweep = parts.runs.create_sweep(
            body.name, config, grid, body.seeds, actor=who.name, place=parts.place
        )
        return sweep.id

    sweep_id = once(parts.database, who, "createSweep", key, body, make=create)
    response.headers["Location"] = f"/api/v1/sweeps/{sweep_id}"
    return _shown(parts, [parts.runs.get_sweep(sweep_id)])[0]


@router.get("/sweeps/{sweep_id}", operation_id="getSweep", responses=responses(404))
def get_sweep(_who: Viewer, parts: Parts, sweep_id: str) -> Sweep:
    """One sweep."""
    return _shown(parts, [parts.runs.get_sweep(sweep_id)])[0]


@router.post(
    "/sweeps/{sweep_id}/stop", operation_id="stopSweep", responses=responses(404, 409, 507)
)
def stop_sweep(who: Operator, parts: Parts, sweep_id: str) -> Sweep:
    """Stops every run of the sweep that is not over."""
    return _shown(parts, [parts.runs.stop_sweep(sweep_id, who.name)])[0]


@router.get(
    "/sweeps/{sweep_id}/heatmap", operation_id="getSweepHeatmap", responses=responses(404, 422)
)
def sweep_heatmap(
    _who: Viewer, parts: Parts, sweep_id: str, query: Annotated[HeatmapOfSweepQuery, Query()]
) -> Heatmap:
    """A metric over two keys of the sweep's grid."""
    parts.runs.get_sweep(sweep_id)
    return _heatmap(parts, RunFilter(sweep_id=sweep_id, archived=False), query)


@router.get("/heatmap", operation_id="getHeatmap", responses=responses(422))
def heatmap(
    _who: Viewer,
    parts: Parts,
    query: Annotated[HeatmapQuery, Query()],
) -> Heatmap:
    """A metric over two configuration keys of all runs that meet a filter."""
    return _heatmap(parts, query.to_filter(), query)


def _shown(parts: Context, rows: Sequence[SweepRow]) -> list[Sweep]:
    states = parts.runs.sweep_states([row.id for row in rows])
    shown = []
    for row in rows:
        runs = parts.runs.find(RunFilter(sweep_id=row.id, archived=None))
        shown.append(Sweep.of(row, [run.id for run in runs], states[row.id]))
    return shown


def _heatmap(parts: Context, runs: RunFilter, query: _Axes) -> Heatmap:
    rows = parts.runs.find(runs)
    metric = query.metric or (rows[0].return_metric if rows else RETURN)
    value: Value = "highest" if query.value == "best_mean" else "last"
    ends = parts.series.values([row.id for row in rows], metric, value)
    cells: dict[tuple[Any, Any], list[RunRow]] = defaultdict(list)
    for row in rows:
        if row.id in ends:
            cells[row.config[query.x], row.config[query.y]].append(row)
    shown = []
    for (x, y), members in cells.items():
        values = [ends[row.id] for row in members]
        found = over_seeds([row.seed for row in members], values)
        shown.append(
            HeatmapCell(
                x=x, y=y, n=found.seeds, mean=found.mean, std=found.std,
                run_ids=[row.id for row in members],
            )
        )  # fmt: skip
    return Heatmap(
        x=HeatmapAxis(key=query.x, values=sorted({row.config[query.x] for row in rows})),
        y=HeatmapAxis(key=query.y, values=sorted({row.config[query.y] for row in rows})),
        metric=metric,
        value=query.value,
        cells=shown,
    )
