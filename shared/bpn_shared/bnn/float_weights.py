"""A floating-point policy as bytes: an ONNX model with its provenance and one known answer.

docs/float-weights.md defines it. The model takes `pixels` float32[1, C, rows, columns] of 0..255 and gives
P float32[1, |A|].
"""

import hashlib
import struct
from dataclasses import dataclass
from typing import Self
from uuid import UUID

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.blob import Parameters
from bpn_shared.bnn.envelope import NO_RUN, BlobError, Envelope, Header, check_provenance
from bpn_shared.spec.network import NetworkSpec

Preferences = npt.NDArray[np.float32]

MAGIC = b"BPNF"
_ENVELOPE = Envelope("float policy", MAGIC, own="I")
_GRAPH_BYTES = 16 * 1024  # of a model, beside its parameters


@dataclass(frozen=True, eq=False)
class FloatWeights:
    """A float policy with its provenance.

    Attributes:
        model: ONNX, at most `max_model_bytes(spec)`.
        probe_outputs: finite float32[|A|], P of `spec.probe()` as the learner computes it: whoever loads the
            model can verify that it computes the same.
        attempt: how many learners have owned the run.
        version: policy updates done; 0 is the initial policy.

    Raises:
        BlobError: a part has another shape, dtype or value.
    """

    spec: NetworkSpec
    model: bytes
    probe_outputs: Preferences
    run: UUID = NO_RUN
    attempt: int = 0
    version: int = 0

    def __post_init__(self) -> None:
        if not 0 < len(self.model) <= max_model_bytes(self.spec):
            raise BlobError(
                f"model of {len(self.model)} bytes, one with {self.spec} has 1..{max_model_bytes(self.spec)}"
            )
        found = f"{self.probe_outputs.dtype}{list(self.probe_outputs.shape)}"
        if found != f"float32[{self.spec.actions}]":
            raise BlobError(f"probe_outputs are {found}, not float32[{self.spec.actions}]")
        if not np.isfinite(self.probe_outputs).all():
            raise BlobError("probe_outputs are not finite")
        check_provenance(self.attempt, self.version)

    @property
    def scale(self) -> float:
        """P = scale * outputs: the model's outputs are P."""
        return 1.0

    def content_sha256(self) -> str:
        """SHA-256 (hex) of what the policy computes: geometry and model, not run, attempt and version."""
        digest = hashlib.sha256(
            struct.pack("<HHH", self.spec.channels, self.spec.hidden_units, self.spec.actions)
        )
        digest.update(self.model)
        return digest.hexdigest()

    def parameters(self) -> Parameters:
        """The model, which holds every parameter, as what is read back from a kernel is compared with."""
        return {"model": np.frombuffer(self.model, np.uint8)}

    def encode(self) -> bytes:
        """The policy as bytes."""
        header = Header(self.spec, self.run, self.attempt, self.version, len(self.model))
        return _ENVELOPE.seal(header, self.probe_outputs.astype("<f4").tobytes() + self.model)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Reads `encode`'s bytes. The model itself is not looked into.

        Raises:
            BlobError: truncated, oversized, altered, of another schema, or no float policy at all.
        """
        opened = _ENVELOPE.open(data)
        spec, run, attempt, version, model_bytes = opened.header
        outputs_bytes = 4 * spec.actions
        body = _ENVELOPE.body(data, opened, outputs_bytes + int(model_bytes))
        probe_outputs = np.frombuffer(body, "<f4", spec.actions).astype(np.float32)
        return cls(spec, body[outputs_bytes:], probe_outputs, run, attempt, version)


def max_model_bytes(spec: NetworkSpec) -> int:
    """The most that a model with this geometry has: weights and biases in float32, and its graph."""
    return _GRAPH_BYTES + sum(4 * layer.out_channels * (layer.fan_in + 1) for layer in spec.layers)


def max_encoded_size(spec: NetworkSpec) -> int:
    """The most bytes of a float policy with this geometry."""
    return _ENVELOPE.size(spec, 4 * spec.actions + max_model_bytes(spec))
