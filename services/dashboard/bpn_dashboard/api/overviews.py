"""What many runs have in common: for choosing, comparing and looking for reasons, without reading every run."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from sqlalchemy import ColumnElement, func, select

from bpn_dashboard.api.configs import Request as Body
from bpn_dashboard.api.context import Context, Operator, Parts, Viewer
from bpn_dashboard.api.filters import RunFilterQuery
from bpn_dashboard.api.models import MAX_IDS, RunId, Tags
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.columns import column_of
from bpn_dashboard.registry.failures import gather
from bpn_dashboard.registry.observations import Changes
from bpn_dashboard.registry.query import RunFilter, conditions

router = APIRouter(tags=["runs"])

MOST_POINTS = 2000
_MOST_VALUES = 30
_PLAIN = (str, int, float, bool, type(None))


class RunIds(BaseModel):
    """All runs that meet a filter, newest first."""

    ids: list[str]


class KeyValue(BaseModel):
    """A value of a configuration key, and how many runs have it."""

    value: Any
    runs: int


class DifferingKey(BaseModel):
    """A configuration key in which runs differ; `values` are the most frequent of `distinct`."""

    key: str
    distinct: int
    values: list[KeyValue]


class Overview(BaseModel):
    """All runs that meet a filter, however many they are."""

    total: int
    states: dict[str, int]
    tasks: dict[str, int]
    return_metrics: list[str]
    differing: Annotated[
        list[DifferingKey], Field(description="in order of the configuration; the seed is one too")
    ]
    same: Annotated[dict[str, Any], Field(description="what all of them have the same value of")]


class FailureReason(BaseModel):
    """Why runs failed; reasons that differ in numbers alone are one."""

    reason: str
    runs: int
    query: Annotated[str, Field(description="finds them, in the query language")]


class FailureReasons(BaseModel):
    """Those of most runs first."""

    items: list[FailureReason]


class TagCount(BaseModel):
    """A tag and how many runs have it."""

    name: str
    runs: int


class TagCounts(BaseModel):
    """By name."""

    items: list[TagCount]


class TagChange(Body):
    """Tags to add to runs, and to take from them."""

    ids: Annotated[list[RunId], Field(min_length=1, max_length=MAX_IDS)]
    add: Tags = Field(default=[])
    remove: Tags = Field(default=[])


class TagsChanged(BaseModel):
    """How many runs are different now."""

    changed: int


class ValuesQuery(Body):
    """Columns of runs. Either `runs` or `filter` says of which."""

    runs: Annotated[list[RunId], Field(max_length=MAX_IDS)] | None = None
    filter: RunFilterQuery | None = None
    columns: Annotated[
        list[Annotated[str, Field(max_length=250)]],
        Field(min_length=1, max_length=20, description="as of sort: config.KEY, metric.NAME.VALUE"),
    ]


class ValuesAnswer(BaseModel):
    """Columns of the newest runs, at most 2,000; each list has an entry for each run."""

    total: Annotated[int, Field(description="that there are; more than are here")]
    ids: list[str]
    names: list[str]
    seeds: list[int]
    columns: dict[str, list[Any]]


@router.get("/runs/ids", operation_id="listRunIds", responses=responses(422))
def run_ids(_who: Viewer, parts: Parts, query: Annotated[RunFilterQuery, Query()]) -> RunIds:
    """The ids of all runs that meet a filter: to choose them all."""
    wanted = select(RunRow.id).order_by(RunRow.created_at.desc(), RunRow.id.desc())
    with parts.database.reading() as session:
        ids = session.scalars(wanted.where(*_where(parts, query)))
        return RunIds.model_construct(ids=list(ids))


@router.get("/runs/overview", operation_id="getOverview", responses=responses(422))
def overview(_who: Viewer, parts: Parts, query: Annotated[RunFilterQuery, Query()]) -> Overview:
    """States, tasks and differences in configuration of all runs that meet a filter."""
    columns = RunRow.state, RunRow.task, RunRow.return_metric, RunRow.config
    with parts.database.reading() as session:
        rows = list(session.execute(select(*columns).where(*_where(parts, query))))
    counts: dict[str, Counter[Any]] = defaultdict(Counter)
    for *_, config in rows:
        for key, value in config.items():
            counts[key][value if isinstance(value, _PLAIN) else str(value)] += 1
    differing, same = [], {}
    for key, values in counts.items():
        if len(values) == 1 and values.total() == len(rows):
            same[key] = next(iter(values))
            continue
        shown = [KeyValue(value=value, runs=n) for value, n in values.most_common(_MOST_VALUES)]
        differing.append(DifferingKey(key=key, distinct=len(values), values=shown))
    return Overview(
        total=len(rows),
        states=Counter(state for state, *_ in rows),
        tasks=Counter(task for _, task, *_ in rows),
        return_metrics=sorted({metric for *_, metric, _ in rows}),
        differing=differing,
        same=same,
    )


@router.get("/runs/failures", operation_id="listFailures", responses=responses(422))
def failures(
    _who: Viewer, parts: Parts, query: Annotated[RunFilterQuery, Query()]
) -> FailureReasons:
    """Why runs that meet a filter failed, gathered."""
    wanted = (
        select(RunRow.error, func.count())
        .where(*_where(parts, query), RunRow.state == "failed")
        .group_by(RunRow.error)
    )
    with parts.database.reading() as session:
        reasons = gather((error, runs) for error, runs in session.execute(wanted))
    return FailureReasons(
        items=[
            FailureReason(reason=one.example, runs=one.runs, query=_finding(one.part))
            for one in reasons
        ]
    )


@router.post("/runs/values", operation_id="queryValues", responses=responses(404, 422))
def values(_who: Viewer, parts: Parts, body: ValuesQuery) -> ValuesAnswer:
    """Any columns of many runs, for charts of runs over each other."""
    if body.filter is not None and body.runs is None:
        where = _where(parts, body.filter)
    elif body.runs is not None and body.filter is None:
        where = [RunRow.id.in_(body.runs), RunRow.id.not_in(parts.runs.index.gone)]
    else:
        raise ApiError(422, "which-runs", "give either runs or filter")
    names = list(dict.fromkeys(body.columns))
    expressions = [column_of(name).expression for name in names]
    wanted = select(RunRow.id, RunRow.name, RunRow.seed, *expressions).where(*where)
    newest = RunRow.created_at.desc(), RunRow.id.desc()
    with parts.database.reading() as session:
        total = session.scalar(select(func.count()).select_from(RunRow).where(*where)) or 0
        rows = list(session.execute(wanted.order_by(*newest).limit(MOST_POINTS)))
    if body.runs is not None and total < len(set(body.runs)):
        for run_id in body.runs:
            parts.runs.get(run_id)  # says which of them there is not
    return ValuesAnswer(
        total=total,
        ids=[row[0] for row in rows],
        names=[row[1] for row in rows],
        seeds=[row[2] for row in rows],
        columns={name: [row[3 + at] for row in rows] for at, name in enumerate(names)},
    )


@router.get("/tags", operation_id="listTags")
def list_tags(_who: Viewer, parts: Parts) -> TagCounts:
    """All tags of runs that are not archived."""
    wanted = select(RunRow.tags).where(*conditions(RunFilter(without=parts.runs.index.gone)))
    with parts.database.reading() as session:
        counts = Counter(tag for tags in session.scalars(wanted) for tag in tags)
    return TagCounts(
        items=[
            TagCount(name=name, runs=n)
            for name, n in sorted(counts.items(), key=lambda item: item[0].casefold())
        ]
    )


@router.post("/runs/tags", operation_id="changeTags", responses=responses(404, 409, 422, 507))
def change_tags(who: Operator, parts: Parts, body: TagChange) -> TagsChanged:
    """Adds tags to runs and takes others from them; the order of those that stay is kept."""
    known = {run_id: parts.runs.get(run_id).rev for run_id in dict.fromkeys(body.ids)}

    def decide(row: RunRow) -> Changes:
        kept = [tag for tag in row.tags if tag not in body.remove]
        return {"tags": [*kept, *(tag for tag in dict.fromkeys(body.add) if tag not in kept)]}

    rows = [parts.runs.edit(run_id, "tag", who.name, decide) for run_id in known]
    return TagsChanged(changed=sum(row.rev != known[row.id] for row in rows))


def _where(parts: Context, runs: RunFilterQuery) -> Sequence[ColumnElement[bool]]:
    return conditions(parts.runs.of_those_there(runs.to_filter()))


def _finding(part: str) -> str:
    escaped = part.replace("\\", "\\\\").replace('"', '\\"')
    return f'state:failed and error:"{escaped}"' if part else "state:failed"
