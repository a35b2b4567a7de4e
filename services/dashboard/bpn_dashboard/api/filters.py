"""Which runs: the same filter in a list's query string and in a series query's body."""

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model, model_validator

from bpn_dashboard.api.configs import check_names
from bpn_dashboard.registry.columns import column_of
from bpn_dashboard.registry.errors import FilterError
from bpn_dashboard.registry.query import RunFilter
from bpn_dashboard.registry.query_language import MOST_CHARACTERS
from bpn_shared.spec.config import OPTIONS

_CONFIG = "config."
_CONFIG_KEYS: dict[str, Any] = {
    f"config_{name}": (
        Annotated[
            str | None,
            Field(alias=_CONFIG + name, max_length=200, description=f"this value of {name}"),
        ],
        None,
    )
    for name in OPTIONS
}


class _Runs(BaseModel):
    model_config = ConfigDict(extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _todays_names(cls, values: Any) -> Any:
        check_names(values, _CONFIG)
        return values

    search: Annotated[
        str,
        Field(
            max_length=200, description="words, each part of name, notes, tags or id, in any case"
        ),
    ] = ""
    query: Annotated[
        str,
        Field(
            max_length=MOST_CHARACTERS,
            description="in words: alpha>0.5 and (tag:paper or state:failed)",
            examples=["alpha>0.5 and state:failed"],
        ),
    ] = ""
    state: Annotated[
        str, Field(max_length=200, description="states, separated by commas", examples=["running"])
    ] = ""
    task: Annotated[str | None, Field(max_length=100)] = None
    algorithm: Annotated[str | None, Field(max_length=100)] = None
    sweep_id: Annotated[str | None, Field(max_length=100)] = None
    archived: bool = False

    def to_filter(self) -> RunFilter:
        """As the registry takes it."""
        config = {
            name.removeprefix("config_"): value
            for name in self.model_fields_set & _CONFIG_KEYS.keys()
            if (value := getattr(self, name)) is not None
        }
        return RunFilter(
            search=self.search,
            query=self.query,
            states=tuple(state for state in self.state.split(",") if state),
            task=self.task,
            algorithm=self.algorithm,
            sweep_id=self.sweep_id,
            archived=self.archived,
            config=config,
        )


def _sort_key(text: str) -> str:
    try:
        column_of(text.removeprefix("-"))
    except FilterError as error:
        raise ValueError(str(error)) from error
    return text


SortKey = Annotated[str, Field(max_length=250), AfterValidator(_sort_key)]

if TYPE_CHECKING:

    class RunFilterQuery(_Runs):
        """Conditions that a run must all meet."""

else:
    RunFilterQuery = create_model(
        "RunFilter", __base__=_Runs, __doc__="Conditions that a run must all meet.", **_CONFIG_KEYS
    )


class RunListQuery(RunFilterQuery):
    """Which runs, in which order, and which page of them."""

    sort: Annotated[
        SortKey,
        Field(
            description="a run's own column, config.KEY, or metric.NAME.VALUE (last, highest, lowest, mean_5, "
            "mean_20, mean_100); with - before it, descending",
            examples=["-config.alpha", "metric.loss.mean_20"],
        ),
    ] = "-created_at"
    columns: Annotated[
        str,
        Field(
            max_length=2000,
            description="metric.NAME.VALUE, separated by commas: shown as each run's `values`",
        ),
    ] = ""
    cursor: Annotated[
        str | None, Field(max_length=1000, description="next_cursor of the page before")
    ] = None
    limit: Annotated[int, Field(ge=1, le=200)] = 50
