"""Runs: list, start, annotate, stop, resume, archive; many at once."""

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Response
from pydantic import BaseModel, Field

from bpn_dashboard.access.roles import Identity
from bpn_dashboard.api.context import Context, Operator, Parts, Viewer
from bpn_dashboard.api.filters import RunListQuery
from bpn_dashboard.api.idempotency import IdempotencyKey, once
from bpn_dashboard.api.models import (
    BulkAction,
    ConfigDiff,
    ConfigDifference,
    Run,
    RunNew,
    RunPage,
    RunPatch,
)
from bpn_dashboard.api.problems import EXPECTED_ERRORS, ApiError, Problem, problem_of, responses
from bpn_dashboard.registry.columns import metric_of
from bpn_shared.runs.creation import configure
from bpn_shared.spec.algorithms import Algorithm, NetworkKind, offered_algorithms
from bpn_shared.spec.config import OPTIONS, RunConfig
from bpn_shared.spec.installed import offered
from bpn_shared.spec.tasks import FOR_EVERY_TASK, TaskFamily, TaskOptions, TaskSpec

router = APIRouter(tags=["runs"])

_ETAG_HEADER = {"ETag": {"schema": {"type": "string"}, "description": "the run's revision"}}


class AlgorithmChoice(BaseModel):
    """An algorithm that runs can have."""

    name: str
    title: str
    network: NetworkKind
    preset: Annotated[
        dict[str, Any], Field(description="what its runs begin with, before the task's")
    ]
    options: Annotated[
        dict[str, Any], Field(description="its own options, and what they are if not given")
    ]

    @classmethod
    def of(cls, algorithm: Algorithm) -> "AlgorithmChoice":
        """What people who choose it want to know of it."""
        spec = algorithm.spec
        return cls(
            name=spec.name,
            title=spec.title or spec.name,
            network=spec.network,
            preset=spec.preset | spec.fixed,
            options=algorithm.checked({}),
        )


class TaskChoice(BaseModel):
    """A task that runs can have, or have."""

    name: str
    title: str
    action_names: Annotated[
        list[str],
        Field(
            description="what each action does, by number; of several dimensions each choice, the dimensions' "
            "side by side"
        ),
    ]
    action_dims: Annotated[list[int], Field(description="choices of each dimension of an action")]
    frames_stacked: Annotated[int, Field(description="camera frames in one observation")]
    control_period_s: float
    preset: Annotated[dict[str, Any], Field(description="what its runs begin with")]

    @classmethod
    def of(cls, task: TaskSpec) -> "TaskChoice":
        """What people who choose or watch the task want to know of it."""
        return cls(
            name=task.name,
            title=task.title or task.name,
            action_names=list(task.action_names),
            action_dims=list(task.dims),
            frames_stacked=task.frames_stacked,
            control_period_s=task.control_period_s,
            preset=task.options() | task.preset,
        )


class FamilyChoice(BaseModel):
    """Tasks without number of one kind: FAMILY:WHICH."""

    name: str
    title: str
    which: Annotated[str, Field(description="what stands behind the colon, in words")]
    noun: str
    about: str
    pattern: Annotated[str, Field(description="of all that may stand there")]
    examples: list[str]

    @classmethod
    def of(cls, name: str, family: TaskFamily) -> "FamilyChoice":
        """What a form needs."""
        return cls(
            name=name,
            title=family.title,
            which=family.which,
            noun=family.noun,
            about=family.about,
            pattern=family.pattern,
            examples=[whole.removeprefix(f"{name}:") for whole in family.known],
        )


class ConfigSchema(BaseModel):
    """What a run's configuration may hold, with the tasks that are installed beside the dashboard.

    The preset "FAMILY:" is that of a family's tasks without their own; 0 actions: they are found out.
    """

    schema_: dict[str, Any]
    presets: dict[str, dict[str, Any]]
    tasks: list[TaskChoice]
    families: list[FamilyChoice]
    family_options: Annotated[
        list[str],
        Field(description="that families' tasks alone leave open; of other tasks they are fixed"),
    ]
    algorithms: list[AlgorithmChoice]
    defaults: dict[str, Any]

    model_config = {"alias_generator": lambda name: name.rstrip("_"), "populate_by_name": True}


class RunTask(TaskChoice):
    """The task of a run, and how its algorithm acts there."""

    selection: Annotated[
        str,
        Field(
            description="what draws the actions of its data: softmax, epsilon_greedy, or another"
        ),
    ]


class BulkResult(BaseModel):
    """What became of one of them."""

    id: str
    ok: bool
    problem: Problem | None = None


class BulkResults(BaseModel):
    """In the order of the request."""

    results: list[BulkResult]


@router.get("/config-schema", operation_id="getConfigSchema")
def config_schema(_who: Viewer) -> ConfigSchema:
    """The schema of configurations, the values that each task begins with, and the defaults."""
    tasks = offered()
    bare = {f"{family}:": {"actions": 0} for family in tasks.families}
    algorithms = offered_algorithms()
    properties = RunConfig.model_json_schema()["properties"]
    properties["algorithm"]["enum"] = [algorithm.spec.name for algorithm in algorithms]
    return ConfigSchema(
        schema_={"type": "object", "properties": {name: properties[name] for name in OPTIONS}},
        presets={name: preset | bare.get(name, {}) for name, preset in tasks.presets.items()},
        tasks=[TaskChoice.of(task) for task in sorted(tasks.specs, key=_steps_of_run)],
        families=[FamilyChoice.of(name, one) for name, one in sorted(tasks.families.items())],
        family_options=[
            name
            for name in OPTIONS
            if name in TaskOptions.model_fields and name not in FOR_EVERY_TASK
        ],
        algorithms=[AlgorithmChoice.of(algorithm) for algorithm in algorithms],
        defaults={name: _DEFAULTS[name] for name in OPTIONS if name in _DEFAULTS},
    )


_DEFAULTS = {
    name: field.get_default()
    for name, field in RunConfig.model_fields.items()
    if not field.is_required()
}


def _steps_of_run(task: TaskSpec) -> int:
    """Of the robot in a run as the task's preset has it: whoever does not choose begins with the shortest."""
    values = _DEFAULTS | task.preset
    return int(values["iterations"] * values["episodes"] * values["steps"])


@router.get("/runs", operation_id="listRuns", responses=responses(422))
def list_runs(
    _who: Viewer,
    parts: Parts,
    query: Annotated[RunListQuery, Query()],
) -> RunPage:
    """A page of runs. Runs that are made while somebody pages neither repeat nor hide others."""
    key, descending = query.sort.lstrip("-"), query.sort.startswith("-")
    scope = ["runs", query.model_dump(exclude={"cursor", "limit", "columns"})]
    after = None
    if query.cursor is not None:
        value, run_id = parts.cursors.decode(query.cursor, scope)
        after = value, run_id
    page = parts.runs.page(
        query.to_filter(), sort=key, descending=descending, after=after, limit=query.limit
    )
    following = page.next_after and parts.cursors.encode(page.next_after, scope)
    columns = {name: metric_of(name) for name in query.columns.split(",") if name}
    values = parts.series.table([row.id for row in page.rows], list(columns.values()))
    items = [Run.of(row) for row in page.rows]
    for run in items:
        run.values = {name: values[run.id].get(column) for name, column in columns.items()}
    return RunPage.model_construct(items=items, next_cursor=following, total=page.total)


@router.post(
    "/runs",
    operation_id="createRun",
    status_code=201,
    responses=responses(409, 422, 507) | {201: {"headers": _ETAG_HEADER}},
)
def create_run(
    who: Operator, parts: Parts, response: Response, body: RunNew, key: IdempotencyKey = None
) -> Run:
    """Puts a new run into the queue for workers."""

    def create() -> str:
        config = configure(body.config.model_dump(exclude_unset=True), parts.place)
        row = parts.runs.create(
            config, name=body.name, notes=body.notes, tags=body.tags, actor=who.name
        )
        return row.id

    run_id = once(parts.database, who, "createRun", key, body, make=create)
    response.headers["Location"] = f"/api/v1/runs/{run_id}"
    return _answer(parts, response, run_id)


@router.get(
    "/runs/{run_id}",
    operation_id="getRun",
    responses=responses(404) | {200: {"headers": _ETAG_HEADER}},
)
def get_run(_who: Viewer, parts: Parts, response: Response, run_id: str) -> Run:
    """One run."""
    return _answer(parts, response, run_id)


@router.get("/runs/{run_id}/task", operation_id="getTask", responses=responses(404, 422))
def get_task(_who: Viewer, parts: Parts, run_id: str) -> RunTask:
    """The run's task as its configuration has it, whether it is installed here or not."""
    parts.runs.get(run_id)
    config = parts.runs.folder(run_id).config()
    task = TaskChoice.of(config.task_spec).model_dump()
    return RunTask(**task, selection=config.policy)


@router.patch(
    "/runs/{run_id}",
    operation_id="updateRun",
    responses=responses(404, 409, 412, 422, 428, 507) | {200: {"headers": _ETAG_HEADER}},
)
def update_run(
    who: Operator,
    parts: Parts,
    response: Response,
    run_id: str,
    body: RunPatch,
    *,
    if_match: Annotated[str | None, Header(max_length=100, description="the run's ETag")] = None,
) -> Run:
    """Changes name, notes or tags, if nobody else has changed the run since."""
    row = parts.runs.get(run_id)
    if if_match is None:
        raise ApiError(428, "if-match", "send the ETag that you last saw as If-Match")
    if if_match not in ("*", _etag(row.rev)):
        raise ApiError(412, "stale", f"run {run_id} has changed: its ETag is {_etag(row.rev)}")
    parts.runs.update(
        run_id, row.rev, name=body.name, notes=body.notes, tags=body.tags, actor=who.name
    )
    return _answer(parts, response, run_id)


@router.post("/runs/{run_id}/stop", operation_id="stopRun", responses=responses(404, 409, 507))
def stop_run(who: Operator, parts: Parts, response: Response, run_id: str) -> Run:
    """Asks the run's workers to stop; again changes nothing. Robots do not depend on this."""
    parts.runs.request_stop(run_id, who.name)
    return _answer(parts, response, run_id)


@router.post("/runs/{run_id}/resume", operation_id="resumeRun", responses=responses(404, 409, 507))
def resume_run(who: Operator, parts: Parts, response: Response, run_id: str) -> Run:
    """Lets workers go on with the run from where it stands."""
    _resume(parts, run_id, who.name)
    return _answer(parts, response, run_id)


@router.post(
    "/runs/{run_id}/archive", operation_id="archiveRun", responses=responses(404, 409, 507)
)
def archive_run(who: Operator, parts: Parts, response: Response, run_id: str) -> Run:
    """Takes the run out of sight; nothing is deleted."""
    parts.runs.archive(run_id, who.name)
    return _answer(parts, response, run_id)


@router.post(
    "/runs/{run_id}/unarchive", operation_id="unarchiveRun", responses=responses(404, 409, 507)
)
def unarchive_run(who: Operator, parts: Parts, response: Response, run_id: str) -> Run:
    """Brings an archived run back."""
    parts.runs.unarchive(run_id, who.name)
    return _answer(parts, response, run_id)


@router.post("/runs/bulk", operation_id="bulkRuns", responses=responses(422))
def bulk(who: Operator, parts: Parts, body: BulkAction) -> BulkResults:
    """The same for many runs; each succeeds or fails by itself."""
    return BulkResults(results=[_one_of_many(parts, who, body.action, i) for i in body.ids])


@router.get(
    "/runs/{run_id}/config-diff", operation_id="getConfigDiff", responses=responses(404, 422)
)
def config_diff(_who: Viewer, parts: Parts, run_id: str, other: str) -> ConfigDiff:
    """In what a run's configuration differs from another's."""
    this_config, other_config = parts.runs.get(run_id).config, parts.runs.get(other).config
    keys = sorted(this_config.keys() | other_config.keys())
    differences = [
        ConfigDifference(key=key, this=this_config.get(key), other=other_config.get(key))
        for key in keys
        if this_config.get(key) != other_config.get(key)
    ]
    return ConfigDiff(same=len(keys) - len(differences), differences=differences)


def _one_of_many(parts: Context, who: Identity, action: str, run_id: str) -> BulkResult:
    acts: dict[str, Callable[[str, str], object]] = {
        "stop": parts.runs.request_stop,
        "resume": partial(_resume, parts),
        "archive": parts.runs.archive,
        "unarchive": parts.runs.unarchive,
        "remove": parts.removals.remove,
        "restore": parts.removals.restore,
    }
    try:
        acts[action](run_id, who.name)
    except EXPECTED_ERRORS as error:
        return BulkResult(id=run_id, ok=False, problem=problem_of(error))
    return BulkResult(id=run_id, ok=True)


def _resume(parts: Context, run_id: str, actor: str) -> None:
    """What a new run would be refused for, one that goes on is refused for."""
    parts.runs.get(run_id)
    parts.place.check(parts.runs.folder(run_id).config())
    parts.runs.request_resume(run_id, actor)


def _answer(parts: Context, response: Response, run_id: str) -> Run:
    row = parts.runs.get(run_id)
    response.headers["ETag"] = _etag(row.rev)
    return Run.of(row)


def _etag(rev: int) -> str:
    return f'"{rev}"'
