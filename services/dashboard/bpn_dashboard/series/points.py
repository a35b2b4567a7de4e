"""Points of one series in memory, and as the bytes of chunks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bpn_dashboard.series.downsample import Floats

Steps = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Points:
    """Points of one series, each iteration once, ascending: steps int64[n], values float64[n]."""

    steps: Steps
    values: Floats

    @classmethod
    def written(cls, steps: Sequence[int], values: Sequence[float]) -> "Points":
        """Points in the order in which they were written; the later of two at one iteration counts."""
        return _latest(np.asarray(steps, np.int64), np.asarray(values, np.float64))

    @classmethod
    def joined(cls, parts: Sequence["Points"]) -> "Points":
        """Points that follow each other."""
        return cls(
            np.concatenate([part.steps for part in parts]),
            np.concatenate([part.values for part in parts]),
        )

    def after(self, older: "Points") -> "Points":
        """Both together; where both have an iteration, this one's value counts."""
        both = Points.joined([older, self])
        if not len(older.steps) or self.steps[0] > older.steps[-1]:
            return both
        return _latest(both.steps, both.values)

    def between(self, first: float, last: float) -> "Points":
        """The points with first <= iteration <= last."""
        begin = np.searchsorted(self.steps, first)
        end = np.searchsorted(self.steps, last, side="right")
        return Points(self.steps[begin:end], self.values[begin:end])

    def split(self, size: int) -> Iterator[tuple[int, "Points"]]:
        """Pieces of `size` consecutive iterations, each with its number: iteration // size."""
        parts = self.steps // size
        for part in np.unique(parts).tolist():
            yield part, self.between(part * size, (part + 1) * size - 1)

    def to_bytes(self) -> tuple[int, bytes | None, bytes]:
        """First iteration, iterations (None if they are without a gap), values; little-endian."""
        first = int(self.steps[0])
        gapless = self.steps[-1] - first + 1 == len(self.steps)
        steps = None if gapless else self.steps.astype("<i8").tobytes()
        return first, steps, self.values.astype("<f8").tobytes()

    @classmethod
    def from_bytes(cls, first: int, steps: bytes | None, values: bytes) -> "Points":
        """Reads `to_bytes`."""
        floats = np.frombuffer(values, "<f8")
        if steps is None:
            return cls(np.arange(first, first + len(floats), dtype=np.int64), floats)
        return cls(np.frombuffer(steps, "<i8"), floats)


NO_POINTS = Points(np.empty(0, np.int64), np.empty(0))


def _latest(steps: Steps, values: Floats) -> Points:
    unique, from_end = np.unique(steps[::-1], return_index=True)
    return Points(unique, values[::-1][from_end])
