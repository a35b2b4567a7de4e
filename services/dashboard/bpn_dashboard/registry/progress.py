"""How far a run has come: read from its metrics line by line, as they are written."""

import math
from collections import deque
from math import nan
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from bpn_shared.runs.digests import DamagedError, check_line
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.tail import Tail

_MEAN_OF = 5
_Count = Annotated[int, Field(ge=0, lt=2**53)]
_Number = Annotated[
    float, Field(allow_inf_nan=True), BeforeValidator(lambda v: nan if v is None else v)
]
"""Null is a value that an iteration should have and has not, as one of a learning that diverged."""


class Record(BaseModel):
    """What a line of metrics.jsonl says of an iteration, as far as it is summed up here."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True)

    iteration: _Count
    weights_version: Annotated[int, Field(ge=0, lt=2**63)]
    length: _Number
    return_px: _Number = nan
    time_unix_s: _Number = 0.0
    return_own: Annotated[_Number, Field(validation_alias="return")] = nan

    @model_validator(mode="after")
    def _has_a_return(self) -> Self:
        if not {"return_px", "return_own"} & self.model_fields_set:
            raise ValueError("no return")
        return self

    @property
    def mean_return(self) -> float:
        """In the unit of the run's return metric."""
        return self.return_px if "return_px" in self.model_fields_set else self.return_own


class Progress:
    """The summary columns of one run's row. Each `read` takes in what was written since the last one."""

    def __init__(self, folder: RunFolder) -> None:
        self._tail = Tail(folder.path / "metrics.jsonl", root=folder.path.parent)
        self._begin()

    def _begin(self) -> None:
        self._last: Record | None = None
        self._returns: deque[float] = deque(maxlen=_MEAN_OF)
        self._best: float | None = None

    @property
    def newest_unix_s(self) -> float:
        """When the newest iteration was written down; 0: there is none, or it does not tell."""
        at_s = 0.0 if self._last is None else self._last.time_unix_s
        return at_s if math.isfinite(at_s) else 0.0

    def read(self) -> dict[str, Any]:
        """Iterations done and what they came to, by column of `RunRow`.

        Raises:
            OSError: the file cannot be read.
        """
        while (growth := self._tail.read()).data or growth.is_new:
            if growth.is_new:
                self._begin()
            for line in growth.lines():
                try:
                    check_line(line)
                    self._take(Record.model_validate_json(line))
                except (DamagedError, ValidationError):
                    continue  # cut by a crash, or damaged; the series count and name such lines
        last = self._last
        if last is None:
            return {"iteration": 0}
        return {
            "iteration": last.iteration + 1,
            "weights_version": last.weights_version,
            "return_last": _finite(self._returns[-1]),
            "return_best": self._best,
            "return_mean_last_5": _finite(sum(self._returns) / len(self._returns)),
            "length_last": _finite(last.length),
        }

    def _take(self, record: Record) -> None:
        if self._last is not None and record.iteration <= self._last.iteration:
            self._returns.pop()  # after a crash an iteration may stand twice
        self._last = record
        self._returns.append(record.mean_return)
        if math.isfinite(record.mean_return):
            best = record.mean_return if self._best is None else self._best
            self._best = max(best, record.mean_return)


def _finite(value: float) -> float | None:
    """What a database holds and JSON carries."""
    return value if math.isfinite(value) else None
