"""A kernel that lets numpy's BLAS multiply: `bpn train reaching --kernel blas`.

Every sum of a binarized network is an integer below 2**24: float32 has it exactly, in any order of summation.
"""

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel.protocol import binarized, checksum_of, not_loaded
from bpn_shared.bnn.blob import Parameters, WeightBlob
from bpn_shared.bnn.golden import Integers, Observation, check_observation, patches
from bpn_shared.bnn.weights import Weights


class BlasKernel:
    """A `Kernel` for binarized policies."""

    name = "blas"

    def __init__(self) -> None:
        self._blob: WeightBlob | None = None
        self._columns: list[npt.NDArray[np.float32]] = []  # of each layer, [fan_in, out]

    @property
    def blob(self) -> WeightBlob:
        if self._blob is None:
            raise not_loaded(self.name)
        return self._blob

    def load(self, weights: Weights) -> None:
        blob = binarized(self.name, weights)
        self._columns = [signs.T.astype(np.float32) for signs in blob.weights]
        self._blob = blob

    def read_back(self) -> Parameters:
        held = [columns.T.astype(np.int8) for columns in self._columns]
        named = zip(self.blob.spec.layers, held, strict=True)
        return self.blob.parameters() | {f"weights of {layer.name}": w for layer, w in named}

    def checksum(self) -> int:
        return checksum_of(self.read_back())

    def run(self, observation: Observation) -> Integers:
        blob = self.blob
        check_observation(blob.spec, observation)
        x = observation.transpose(1, 2, 0).astype(np.int32)
        for layer, columns, tau in zip(
            blob.spec.layers, self._columns, (*blob.thresholds, None), strict=True
        ):
            o = (patches(layer, x).astype(np.float32) @ columns).astype(np.int32)
            x = o if tau is None else np.where(o >= tau, 1, -1).astype(np.int32)
        return x.reshape(-1)
