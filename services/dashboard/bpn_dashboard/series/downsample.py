"""Few buckets for many points, so that no extreme is lost and no bucket moves when points are added.

Buckets are as wide as a power of two and begin at its multiples. A bucket that lies before the newest
point is therefore closed: what is appended later cannot change it, and zooming splits it exactly in two.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Buckets:
    """What is known of each bucket; all float64[k], ascending in `x`.

    Points that are NaN count nowhere; a bucket that has no others is there all the same, with NaN for all but `n`:
    a hole in a series shall be seen as one.

    Attributes:
        x: where the bucket begins.
        n: points in it that are numbers.
        min: the smallest value.
        max: the largest value.
        sum: of the values.
        last: the value of the largest x.
    """

    x: Floats
    n: Floats
    min: Floats
    max: Floats
    sum: Floats
    last: Floats

    @classmethod
    def joined(cls, parts: Sequence["Buckets"]) -> Self:
        """Buckets one after the other."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))

    @property
    def mean(self) -> Floats:
        return self.sum / self.n

    def between(self, low: float, high: float) -> "Buckets":
        """The buckets that begin in [low, high]."""
        first, end = np.searchsorted(self.x, low), np.searchsorted(self.x, high, side="right")
        return Buckets(*(getattr(self, f.name)[first:end] for f in fields(self)))

    def merge(self, width: float) -> "Buckets":
        """Coarser buckets of this width, which must be a multiple of the present one."""
        return self._gathered(np.floor(self.x / width) * width)

    def _gathered(self, starts: Floats) -> "Buckets":
        """One bucket for each value in `starts` float64[k], ascending: where those begin that these join."""
        if not len(starts):
            return self
        first = np.flatnonzero(np.diff(starts, prepend=-np.inf))
        n = np.add.reduceat(self.n, first)
        # The newest number of each, or its first where it has none.
        numbers = np.where(self.n > 0, np.arange(len(starts)), -1)
        newest = np.maximum(np.maximum.reduceat(numbers, first), first)
        sums = np.add.reduceat(np.where(self.n > 0, self.sum, 0.0), first)
        return Buckets(
            x=starts[first],
            n=n,
            min=np.fmin.reduceat(self.min, first),
            max=np.fmax.reduceat(self.max, first),
            sum=np.where(n > 0, sums, np.nan),
            last=self.last[newest],
        )

    def to_bytes(self) -> bytes:
        """The six columns one after the other, little-endian float64."""
        return np.stack([getattr(self, f.name) for f in fields(self)]).astype("<f8").tobytes()

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Reads `to_bytes`."""
        return cls(*np.frombuffer(data, "<f8").reshape(len(fields(cls)), -1))


NO_BUCKETS = Buckets.from_bytes(b"")


def bucketize(x: Floats, values: Floats, width: float | None = None) -> Buckets:
    """Points in buckets of this width; None: every x has a bucket of its own.

    Args:
        x: float64[n], ascending; what stands at one x shares a bucket.
        values: float64[n]; NaN: there is no number.
        width: a power of two.
    """
    n = (~np.isnan(values)).astype(np.float64)
    points = Buckets(x, n, values, values, values, values)
    if width is not None:
        return points.merge(width)
    return points._gathered(x) if (np.diff(x) == 0).any() else points


def bucket_width(low: float, high: float, max_buckets: int) -> float:
    """The smallest power of two of which at most `max_buckets` buckets cover [low, high]."""
    if high <= low:
        return 1.0
    width = 2.0 ** math.ceil(math.log2((high - low) / max_buckets))
    while math.floor(high / width) - math.floor(low / width) >= max_buckets:
        width *= 2
    return width
