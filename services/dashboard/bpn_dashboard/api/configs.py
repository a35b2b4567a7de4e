"""Configurations in requests: models made from `RunConfig`, so that neither can miss a key."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    create_model,
    model_validator,
)

from bpn_shared.spec.config import OPTIONS, RunConfig
from bpn_shared.spec.renamed import called_now


class Request(BaseModel):
    """The base of all bodies: nothing unknown, nothing converted."""

    model_config = ConfigDict(strict=True, extra="forbid")


class _Values(Request):
    """What has configuration keys; names of before are refused with those of today."""

    @model_validator(mode="before")
    @classmethod
    def _todays_names(cls, values: Any) -> Any:
        check_names(values)
        return values


def check_names(values: Any, prefix: str = "") -> None:
    """Refuses configuration keys that have another name today.

    Raises:
        ValueError: the message says which, and how they are called.
    """
    if isinstance(values, dict):
        told = [f"{name} {why}" for name in values if (why := _why(name, prefix)) is not None]
        if told:
            raise ValueError("; ".join(told))


def _why(name: object, prefix: str) -> str | None:
    return called_now(name.removeprefix(prefix)) if isinstance(name, str) else None


def _key_of_today(key: Any) -> Any:
    check_names({key: None} if isinstance(key, str) else {})
    return key


def _kinds() -> dict[str, Any]:
    """The type of each configuration key, with its range."""
    fields = ((name, RunConfig.model_fields[name]) for name in OPTIONS)
    return {
        name: Annotated[field.annotation, *field.metadata, Field(description=field.description)]
        for name, field in fields
    }


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

    class RunChanges(_Values):
        """A task, and what is changed from its preset."""

    class SweepGrid(_Values):
        """For configuration keys, the values to try."""

else:
    ConfigKey = Annotated[Literal[OPTIONS], BeforeValidator(_key_of_today)]

    RunChanges = create_model(
        "RunChanges",
        __base__=_Values,
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
        __base__=_Values,
        __doc__="For configuration keys, the values to try.",
        **{
            name: (
                Annotated[list[kind], Field(min_length=1, max_length=100), AfterValidator(differ)],
                Field(default=None, json_schema_extra=_unique_schema),
            )
            for name, kind in _kinds().items()
        },
    )
