"""What requests and answers hold. Requests are strict: nothing unknown, nothing converted."""

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, Field

from bpn_dashboard.api.configs import Request, RunChanges, SweepGrid, differ
from bpn_dashboard.database.tables import RunRow, SweepRow
from bpn_dashboard.database.text_keys import is_visible
from bpn_shared.runs.folder import State
from bpn_shared.runs.trash import Removed
from bpn_shared.spec.tasks import RETURN_PX

MAX_IDS = 1000


def _readable(text: str) -> str:
    """Refuses what looks like nothing, or makes what stands beside it look like something else."""
    for character in text:
        if not is_visible(character):
            raise ValueError(f"U+{ord(character):04X} cannot be seen: leave it out")
    return text.strip()


Name = Annotated[str, Field(max_length=200), AfterValidator(_readable)]
Notes = Annotated[str, Field(max_length=20_000)]
Tag = Annotated[str, Field(max_length=50), AfterValidator(_readable), Field(min_length=1)]
Tags = Annotated[list[Tag], Field(max_length=50)]
RunId = Annotated[str, Field(min_length=36, max_length=36)]
MetricName = Annotated[str, Field(min_length=1, max_length=200)]


class ReturnSummary(BaseModel):
    """Mean returns of the iterations done."""

    metric: Annotated[str, Field(description="its name among the run's metrics")]
    unit: Annotated[str, Field(description="px, or nothing where the environment has its own")]
    last: float | None
    best: float | None
    mean_last_5: float | None


class LengthSummary(BaseModel):
    """Steps of an episode."""

    last: float | None


class RunSummary(BaseModel):
    """Where the learning stands."""

    returns: ReturnSummary
    length: LengthSummary


class Run(BaseModel):
    """A run. `state` is what is observed, `desired_state` what was asked for."""

    id: str
    name: str
    state: State
    desired_state: Literal["running", "stopped"]
    task: str
    algorithm: str
    seed: int
    config: dict[str, Any]
    config_hash: str
    attempt: int
    iteration: Annotated[int, Field(description="iterations done")]
    iterations: int
    weights_version: int | None
    summary: RunSummary
    values: Annotated[
        dict[str, float | None], Field(description="of the `columns` that a list was asked for")
    ] = {}
    error: str
    waiting_reason: Annotated[
        str, Field(description="why it makes no progress though it shall; empty if it does")
    ]
    waiting_since_unix_s: float | None
    notes: str
    tags: list[str]
    sweep_id: str | None
    priority: Annotated[int, Field(description="of those that wait the highest is served first")]
    archived_at_unix_s: float | None
    created_at_unix_s: float
    updated_at_unix_s: float
    disk_bytes: Annotated[int | None, Field(description="of its folder; null: not measured yet")]
    rev: Annotated[int, Field(description="grows when people change the run; the ETag")]

    @classmethod
    def of(cls, row: RunRow) -> Self:
        """The row as the API shows it."""
        same = {name: getattr(row, name) for name in cls.model_fields if hasattr(RunRow, name)}
        return cls.model_construct(
            **same,
            values={},
            summary=RunSummary(
                returns=ReturnSummary(
                    metric=row.return_metric,
                    unit="px" if row.return_metric == RETURN_PX else "",
                    last=row.return_last,
                    best=row.return_best,
                    mean_last_5=row.return_mean_last_5,
                ),
                length=LengthSummary(last=row.length_last),
            ),
            waiting_since_unix_s=row.waiting_since,
            archived_at_unix_s=row.archived_at,
            created_at_unix_s=row.created_at,
            updated_at_unix_s=row.updated_at,
        )


class RunPage(BaseModel):
    """Some of the runs; `next_cursor` continues, `total` counts all that meet the filter."""

    items: list[Run]
    next_cursor: str | None
    total: int


class RemovedRun(BaseModel):
    """A run in the trash."""

    id: str
    name: str
    removed_at_unix_s: float
    removed_by: Annotated[str, Field(description="empty: that could not be written down")]
    kept_until_unix_s: Annotated[float, Field(description="then it is deleted for good")]
    size_bytes: Annotated[
        int | None, Field(ge=0, description="of its files; null: that could not be written down")
    ]

    @classmethod
    def of(cls, removed: Removed, name: str) -> Self:
        """As the API shows it."""
        return cls(
            id=removed.run,
            name=name,
            removed_at_unix_s=removed.at_unix_s,
            removed_by=removed.by,
            kept_until_unix_s=removed.until_unix_s,
            size_bytes=removed.size_bytes,
        )


class RunNew(Request):
    """A run to start."""

    config: RunChanges
    name: Name = ""
    notes: Notes = ""
    tags: Tags = Field(default=[])


class RunPatch(Request):
    """What people say about a run; what is left out stays."""

    name: Name | None = None
    notes: Notes | None = None
    tags: Tags | None = None


class BulkAction(Request):
    """The same for many runs."""

    action: Literal["stop", "resume", "archive", "unarchive", "remove", "restore"]
    ids: Annotated[list[RunId], Field(min_length=1, max_length=MAX_IDS)]


class ConfigDifference(BaseModel):
    """A key that two configurations have different values of."""

    key: str
    this: Any
    other: Any


class ConfigDiff(BaseModel):
    """Two configurations compared: how many keys are the same, and which are not."""

    same: int
    differences: list[ConfigDifference]


class SweepNew(Request):
    """A sweep: every combination of the grid's values, with every seed."""

    name: Name
    config: RunChanges
    grid: SweepGrid = Field(default_factory=SweepGrid)
    seeds: Annotated[
        list[Annotated[int, Field(ge=0, lt=2**63)]],
        Field(max_length=MAX_IDS, json_schema_extra={"uniqueItems": True}),
        AfterValidator(differ),
    ] = Field(default=[])


class Sweep(BaseModel):
    """A sweep, and how its runs are doing."""

    id: str
    name: str
    config: dict[str, Any]
    grid: dict[str, list[Any]]
    seeds: list[int]
    run_ids: list[str]
    states: Annotated[dict[str, int], Field(description="how many runs are in each state")]
    created_at_unix_s: float

    @classmethod
    def of(cls, row: SweepRow, run_ids: list[str], states: dict[str, int]) -> Self:
        """The row as the API shows it."""
        return cls(
            id=row.id,
            name=row.name,
            config=row.config,
            grid=row.grid,
            seeds=row.seeds,
            run_ids=run_ids,
            states=states,
            created_at_unix_s=row.created_at,
        )
