"""Float policies in ONNX Runtime, on one thread."""

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel.protocol import OutputError, checksum_of, not_loaded
from bpn_shared.bnn.blob import Parameters
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.golden import Observation, check_observation
from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.config import ConfigError

try:
    import onnxruntime

    from bpn_edge.kernel.onnx_admission import admit
except ModuleNotFoundError as error:
    raise ConfigError(
        f"kernel 'onnx' needs {error.name}, which is not installed: pip install 'bpn-edge[float]' "
        "for float policies, or choose algorithm bpn or bqn"
    ) from error


_INPUT = "pixels"
_FATAL_ONLY = 4


class OnnxKernel:
    """A `Kernel` whose outputs are P itself."""

    name = "onnx"

    def __init__(self) -> None:
        self._loaded: tuple[onnxruntime.InferenceSession, FloatWeights] | None = None

    def load(self, weights: Weights) -> None:
        """See `Kernel.load`."""
        if not isinstance(weights, FloatWeights):
            raise BlobError(f"the {self.name} kernel runs float policies, this one is binarized")
        admit(weights.model, weights.spec)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = (
            _FATAL_ONLY  # errors are raised, and said once by whoever catches them
        )
        try:
            session = onnxruntime.InferenceSession(
                weights.model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # its exceptions have no common class of their own
            raise BlobError(
                f"ONNX Runtime cannot load the model: {type(error).__name__}"
            ) from error
        self._loaded = session, weights

    def read_back(self) -> Parameters:
        """See `Kernel.read_back`; the bytes that the session was made from: ONNX Runtime shows no more."""
        if self._loaded is None:
            raise not_loaded(self.name)
        return self._loaded[1].parameters()

    def checksum(self) -> int:
        """See `Kernel.checksum`."""
        return checksum_of(self.read_back())

    def run(self, observation: Observation) -> npt.NDArray[np.float32]:
        """See `Kernel.run`; P, float32[|A|]."""
        if self._loaded is None:
            raise not_loaded(self.name)
        session, weights = self._loaded
        check_observation(weights.spec, observation)
        preferences: npt.NDArray[np.float32] = session.run(None, {_INPUT: _pixels(observation)})[0][
            0
        ]
        broken = np.count_nonzero(~np.isfinite(preferences))
        if broken:
            raise OutputError(
                f"{broken} of the {preferences.size} outputs are not finite: no action can be chosen by them"
            )
        return preferences


def _pixels(observation: Observation) -> npt.NDArray[np.float32]:
    return observation.astype(np.float32)[np.newaxis]
