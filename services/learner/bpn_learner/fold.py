"""Batch norm and Sign folded into integer thresholds: a trained network as a weight blob."""

from typing import TYPE_CHECKING
from uuid import UUID

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.blob import Thresholds, WeightBlob
from bpn_shared.bnn.envelope import NO_RUN

if TYPE_CHECKING:
    from bpn_learner.networks import BinaryNetwork

Floats = npt.NDArray[np.float64]


def fold(
    network: "BinaryNetwork", *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0
) -> WeightBlob:
    """The evaluated network as integers (section IV-B b): equal to it for every observation, bit by bit.

    A channel whose a of Sign(a o + b) is negative has its weights flipped, for then o changes its sign
    and a o does not. P's factor is lambda as float32.

    Raises:
        BlobError: lambda is not finite or not above 0.
    """
    weights = [s.detach().cpu().numpy().astype(np.int8) for s in network.signs()]
    thresholds: list[Thresholds] = []
    for index, (a_tensor, b_tensor) in enumerate(network.affine()):
        a, b = a_tensor.cpu().numpy(), b_tensor.cpu().numpy()
        weights[index][a < 0] *= -1
        limit = network.spec.layers[index].max_output
        thresholds.append(smallest_positive(np.abs(a), b, limit))
    scale = float(network.scale().detach())
    return WeightBlob(network.spec, tuple(weights), tuple(thresholds), scale, run, attempt, version)


def smallest_positive(a: Floats, b: Floats, limit: int) -> Thresholds:
    """The smallest integer o in [-limit, limit] with a o + b >= 0 as float64 evaluates it.

    By bisection over the expression itself, which rounding leaves monotone: ties, tiny and huge values
    need no case of their own. A channel that is never on gets limit + 1, one always on gets -limit.

    Args:
        a: float64[out], not negative.
        b: float64[out].
        limit: largest |o|.

    Returns:
        int32[out].
    """
    low = np.full(a.shape, -limit, np.int64)
    high = np.full(a.shape, limit + 1, np.int64)  # the answer is in low..high
    while np.any(low < high):
        middle = (low + high) // 2
        on = a * middle + b >= 0
        high = np.where(on, middle, high)
        low = np.where(on, low, np.minimum(middle + 1, high))
    return high.astype(np.int32)
