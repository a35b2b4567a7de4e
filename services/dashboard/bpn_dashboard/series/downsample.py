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
    """What is known of each bucket; all float64[k], ascending in `x`. Points that are NaN are left out.

    Attributes:
        x: where the bucket begins.
        n: points in it.
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
        if not len(self.x):
            return self
        starts = np.floor(self.x / width) * width
        first = np.flatnonzero(np.diff(starts, prepend=-np.inf))
        end = np.append(first[1:], len(starts)) - 1
        return Buckets(
            x=starts[first],
            n=np.add.reduceat(self.n, first),
            min=np.minimum.reduceat(self.min, first),
            max=np.maximum.reduceat(self.max, first),
            sum=np.add.reduceat(self.sum, first),
            last=self.last[end],
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
    """Points in buckets of this width; None: every point in a bucket of its own, with its x.

    Args:
        x: float64[n], ascending.
        values: float64[n]; NaN is left out.
        width: a power of two.
    """
    kept = ~np.isnan(values)
    x, values = x[kept], values[kept]
    points = Buckets(x, np.ones_like(x), values, values, values, values)
    return points if width is None else points.merge(width)


def bucket_width(low: float, high: float, max_buckets: int) -> float:
    """The smallest power of two of which at most `max_buckets` buckets cover [low, high]."""
    if high <= low:
        return 1.0
    width = 2.0 ** math.ceil(math.log2((high - low) / max_buckets))
    while math.floor(high / width) - math.floor(low / width) >= max_buckets:
        width *= 2
    return width
