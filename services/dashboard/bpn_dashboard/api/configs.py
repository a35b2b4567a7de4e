"""Configurations in requests: models made from `RunConfig`, so that neither can miss a key."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model

from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.tasks import TASK_NAMES, TASK_PATTERN, check_task_name


class Request(BaseModel):
    """The base of all bodies: nothing unknown, nothing converted."""

    model_config = ConfigDict(strict=True, extra="forbid")


def _kinds() -> dict[str, Any]:
    """The type of each configuration key, with its range."""
    kinds: dict[str, Any] = {
        name: Annotated[field.annotation, *field.metadata, Field(description=field.description)]
        for name, field in RunConfig.model_fields.items()
    }
    task = Field(description=f"one of {TASK_NAMES}", json_schema_extra={"pattern": TASK_PATTERN})
    return kinds | {"task": Annotated[str, task, AfterValidator(check_task_name)]}


def _no_default(schema: dict[str, Any]) -> None:
    schema.pop("default", None)  # the task's preset decides what a key that is left out is


def differ(values: list[Any]) -> list[Any]:
    """The values, if none stands there twice."""
    if any(value in values[:index] for index, value in enumerate(values)):
        raise ValueError("values must differ from each other")
    return values


def _unique_schema(schema: dict[str, Any]) -> None:
    _no_default(schema)
    schema["uniqueItems"] = True


if TYPE_CHECKING:
    ConfigKey = str

    class RunChanges(Request):
        """A task, and what is changed from its preset."""

    class SweepGrid(Request):
        """For configuration keys, the values to try."""

else:
    ConfigKey = Literal[tuple(RunConfig.model_fields)]

    RunChanges = create_model(
        "RunChanges",
        __base__=Request,
        __doc__="A task, and what is changed from its preset.",
        **{
            name: (
                kind,
                Field(default=...)
                if name == "task"
                else Field(default=None, json_schema_extra=_no_default),
            )
            for name, kind in _kinds().items()
        },
    )

    SweepGrid = create_model(
        "SweepGrid",
        __base__=Request,
        __doc__="For configuration keys, the values to try.",
        **{
            name: (
                Annotated[list[kind], Field(min_length=1, max_length=100), AfterValidator(differ)],
                Field(default=None, json_schema_extra=_unique_schema),
            )
            for name, kind in _kinds().items()
        },
    )
