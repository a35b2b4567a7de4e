"""best.json: which version of a run's policy was the best in the evaluations during training."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.spec.config import ConfigError

SCHEMA = 1


class Best(BaseModel):
    """A version, the metric by which it is the best, and its value."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    version: Annotated[int, Field(ge=0, lt=2**32)]
    metric: str
    value: float


def encode_best(version: int, metric: str, value: float) -> bytes:
    """The bytes of best.json."""
    best = Best(version=version, metric=metric, value=value)
    return seal({"schema": SCHEMA, **best.model_dump()})


def decode_best(data: bytes, *, source: str) -> Best:
    """Reads `encode_best`'s bytes.

    Raises:
        ConfigError: damaged, or of another version.
    """
    try:
        values, has_digest = unseal(data)
        schema = values.pop("schema", None)
        if schema != SCHEMA:
            raise ConfigError(f"{source}: schema {schema!r}, this program reads {SCHEMA}")
        if not has_digest:
            raise DamagedError("it has lost its sha256")
        return Best.model_validate(values)
    except (DamagedError, ValidationError) as error:
        raise ConfigError(
            f"{source} is damaged: choose a version by --version; metrics.jsonl has eval_return of each"
        ) from error
