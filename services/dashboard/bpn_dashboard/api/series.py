"""Metrics of runs: what there is, curves of groups, and files to take away."""

from typing import Annotated, Any, Literal

import orjson
from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from bpn_dashboard.api import export
from bpn_dashboard.api.configs import ConfigKey
from bpn_dashboard.api.configs import Request as Body
from bpn_dashboard.api.context import Parts, Viewer
from bpn_dashboard.api.filters import RunFilterQuery
from bpn_dashboard.api.groups import Group, group_runs
from bpn_dashboard.api.models import MAX_IDS, MetricName, RunId
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.api.subject import runs_of
from bpn_dashboard.series.axes import Axis
from bpn_dashboard.series.query import Series, View
from bpn_dashboard.series.statistics import Band, Statistic

router = APIRouter(tags=["series"])

BINARY = "application/vnd.bpn.series"
_COLUMNS = ("x", "n", "value", "low", "high", "min", "max", "last")
_MAX_CURVES = 2000

Number = Annotated[float, Field(allow_inf_nan=False)]


class MetricCount(BaseModel):
    """A metric and how many points it has."""

    name: str
    n: int


class MetricNames(BaseModel):
    """The metrics of a run."""

    names: list[MetricCount]


class SeriesQuery(Body):
    """Curves to draw. Either `runs` or `filter` says of which runs."""

    runs: Annotated[list[RunId], Field(max_length=MAX_IDS)] | None = None
    filter: RunFilterQuery | None = None
    group_by: Annotated[
        Annotated[list[ConfigKey], Field(max_length=20)] | Literal["all_but_seed"] | None,
        Field(description="runs alike in these keys form one curve; null: every run for itself"),
    ] = "all_but_seed"
    metrics: Annotated[list[MetricName], Field(min_length=1, max_length=20)]
    x: Axis = "iteration"
    range: Annotated[
        Annotated[list[Number], Field(min_length=2, max_length=2)] | None,
        Field(description="of x: from, to; null: all"),
    ] = None
    max_points: Annotated[int, Field(ge=1, le=4000)] = 1000
    max_groups: Annotated[
        int,
        Field(ge=1, le=_MAX_CURVES, description="where there are more, those of the newest runs"),
    ] = 100
    statistic: Statistic = "mean"
    band: Band = "std"


class ExportQuery(BaseModel):
    """What to export."""

    model_config = {"extra": "forbid"}

    runs: Annotated[
        str, Field(min_length=1, max_length=40_000, description="ids, separated by commas")
    ]
    metrics: Annotated[
        str, Field(min_length=1, max_length=4000, description="names, separated by commas")
    ]
    format: export.Format = "csv"


class SeriesShown(BaseModel):
    """One curve. Columns are equally long; null where there is no value."""

    metric: str
    key: Annotated[str, Field(description="the same for the same group whatever else is shown")]
    label: str
    group: dict[str, Any]
    run_ids: list[str]
    seeds: Annotated[
        int,
        Field(description="of these runs; fewer than runs: those of one seed are averaged first"),
    ]
    n_points: Annotated[int, Field(description="points that the curve was made of")]
    bucket: Annotated[float, Field(description="width of a bucket in x; 0: points as they are")]
    x: list[float]
    n: Annotated[list[float], Field(description="seeds that count at this x")]
    value: list[float | None]
    low: list[float | None]
    high: list[float | None]
    min: list[float | None]
    max: list[float | None]
    last: list[float | None]


class SeriesAnswer(BaseModel):
    """Curves, in order of groups and metrics; `seq` grows whenever points are added anywhere."""

    series: list[SeriesShown]
    seq: int
    groups: Annotated[
        int, Field(description="that there are; more than shown if max_groups is less")
    ]


@router.get("/runs/{run_id}/metrics", operation_id="listMetrics", responses=responses(404))
def list_metrics(_who: Viewer, parts: Parts, run_id: str) -> MetricNames:
    """Which metrics a run has."""
    parts.runs.get(run_id)
    names = [MetricCount(name=name, n=n) for name, n in parts.series.names(run_id)]
    return MetricNames(names=names)


@router.post(
    "/series/query",
    operation_id="querySeries",
    responses=responses(404, 422)
    | {200: {"model": SeriesAnswer, "content": {BINARY: {"schema": {"format": "binary"}}}}},
)
def query_series(_who: Viewer, parts: Parts, request: Request, body: SeriesQuery) -> Response:
    """Curves from all points of all runs asked for; every bucket keeps its extremes."""
    found_groups = group_runs(runs_of(parts, body.runs, body.filter), body.group_by)
    groups = found_groups[-body.max_groups :]
    if len(groups) * len(body.metrics) > _MAX_CURVES:
        raise ApiError(
            422,
            "too-many-curves",
            f"{len(groups)} groups of {len(body.metrics)} metrics: the limit is {_MAX_CURVES} curves",
        )
    limits = None if body.range is None else (body.range[0], body.range[1])
    view = View(body.x, limits, body.max_points, body.statistic, body.band)
    seq = parts.series.revision()
    found = parts.series.query([group.seeds for group in groups], body.metrics, view)
    owners = [group for group in groups for _ in body.metrics]
    headers = [_header(*both) for both in zip(owners, found, strict=True)]
    curves = [{name: getattr(series.curve, name) for name in _COLUMNS} for series in found]
    if request.headers.get("accept", "").startswith(BINARY):
        return Response(_binary(headers, curves, seq, len(found_groups)), media_type=BINARY)
    shown = [h | c for h, c in zip(headers, curves, strict=True)]
    answer = {"series": shown, "seq": seq, "groups": len(found_groups)}
    data = orjson.dumps(answer, option=orjson.OPT_SERIALIZE_NUMPY)  # NaN becomes null
    return Response(data, media_type="application/json")


@router.get(
    "/series/export",
    operation_id="exportSeries",
    responses=responses(404, 422)
    | {
        200: {
            "content": {
                kind: {"schema": {"type": "string"}} for kind in export.MEDIA_TYPES.values()
            }
        }
    },
)
def export_series(
    _who: Viewer, parts: Parts, query: Annotated[ExportQuery, Query()]
) -> StreamingResponse:
    """Every point of the metrics: a row for each run and iteration."""
    rows = runs_of(parts, [run for run in query.runs.split(",") if run], None)
    metrics = [metric for metric in query.metrics.split(",") if metric]
    export.check(metrics, parts.series.names_in([row.id for row in rows]))
    tables = export.tables(parts.series, rows, metrics)
    return StreamingResponse(
        export.write(tables, metrics, query.format),
        media_type=export.MEDIA_TYPES[query.format],
        headers={"Content-Disposition": f'attachment; filename="series.{query.format}"'},
    )


def _header(group: Group, series: Series) -> dict[str, Any]:
    return {
        "metric": series.metric,
        "key": group.key,
        "label": group.label,
        "group": group.values,
        "run_ids": series.run_ids,
        "seeds": series.seeds,
        "n_points": series.n_points,
        "bucket": series.bucket,
    }


def _binary(
    headers: list[dict[str, Any]], curves: list[dict[str, Any]], seq: int, groups: int
) -> bytes:
    """Length of the header (uint32), the header as JSON, then the columns of each curve as float32.

    Everything is little-endian; spaces at the header's end align the columns to 4 bytes.
    """
    lengths = [len(curve["x"]) for curve in curves]
    described = [h | {"length": length} for h, length in zip(headers, lengths, strict=True)]
    text = orjson.dumps({"series": described, "columns": _COLUMNS, "seq": seq, "groups": groups})
    text += b" " * (-len(text) % 4)
    columns = [curve[name].astype("<f4").tobytes() for curve in curves for name in _COLUMNS]
    return b"".join([len(text).to_bytes(4, "little"), text, *columns])
