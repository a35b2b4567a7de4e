"""state.json: what a run is doing, and who may write into its folder."""

from typing import Annotated, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.spec.config import ConfigError

SCHEMA = 2

State = Literal["queued", "running", "stopping", "finished", "failed", "stopped", "lost"]
STATES: tuple[State, ...] = get_args(State)
OVER: tuple[State, ...] = ("finished", "failed")
"""What stands, until somebody wants the run again."""
ENDED: tuple[State, ...] = (*OVER, "stopped")
"""What a learner says last."""

_REMEDY = "remove the file to let the run go on as its next attempt"


class RunState(BaseModel):
    """What a run is doing, how many learners have owned it (`attempt`), and which one does.

    Attributes:
        owner: the learner that this attempt belongs to; "": nobody writes into the folder.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    state: State = "queued"
    attempt: Annotated[int, Field(ge=0, lt=2**32)] = 0
    created_unix_s: float = 0.0
    updated_unix_s: float = 0.0
    error: str = ""
    owner: str = ""


def encode_state(state: RunState) -> bytes:
    """The bytes of state.json."""
    return seal({"schema": SCHEMA, **state.model_dump()})


def decode_state(data: bytes, *, source: str) -> RunState:
    """Reads `encode_state`'s bytes, and those of schema 1, which had neither schema nor digest.

    Raises:
        ConfigError: damaged, or of another version.
    """
    try:
        values, has_digest = unseal(data)
        schema = values.pop("schema", 1)
        if schema not in range(1, SCHEMA + 1):
            raise ConfigError(
                f"{source}: schema {schema!r}, this program reads 1 to {SCHEMA}: use the version that wrote it"
            )
        if schema > 1 and not has_digest:
            raise DamagedError("it has lost its sha256")
        return RunState.model_validate(values)
    except DamagedError as error:
        raise ConfigError(f"{source}: {error}; {_REMEDY}") from error
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(map(str, first["loc"]))
        raise ConfigError(f"{source}: {name}: {first['msg']}; {_REMEDY}") from error
