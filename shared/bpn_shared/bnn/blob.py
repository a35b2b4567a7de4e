"""The weight blob: one binarized policy as bytes, about 11 KB, the form in which it travels and rests.

Little-endian. Header (40 bytes): magic, schema version, C, N, |A|, run, attempt, version, lambda; then for
each layer its signs (bit 1 = +1, order out, kernel row, kernel column, in; each layer padded with zero
bits to a whole byte); then the thresholds of layers 1-4 as int32; then the SHA-256 of all before it.
"""

import hashlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self
from uuid import UUID

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.envelope import NO_RUN, BlobError, Envelope, Header, check_provenance
from bpn_shared.spec.network import Layer, NetworkSpec

Signs = npt.NDArray[np.int8]
Thresholds = npt.NDArray[np.int32]
Parameters = dict[str, npt.NDArray[Any]]
"""Of a policy, by name."""

MAGIC = b"BPNW"
_ENVELOPE = Envelope("weight blob", MAGIC, schema=1, own="f")


@dataclass(frozen=True, eq=False)
class WeightBlob:
    """A binarized policy with its provenance.

    Attributes:
        weights: per layer int8[out, fan_in] of -1 and +1 (see `Layer.weight_shape`).
        thresholds: tau of layers 1-4, int32[out]; the activation is +1 iff o >= tau.
        scale: lambda of P = lambda * o_5, a finite float32 above 0.
        attempt: how many learners have owned the run.
        version: policy updates done; 0 is the initial policy.

    Raises:
        BlobError: a part has another shape, dtype or value.
    """

    spec: NetworkSpec
    weights: tuple[Signs, ...]
    thresholds: tuple[Thresholds, ...]
    scale: float
    run: UUID = NO_RUN
    attempt: int = 0
    version: int = 0

    def __post_init__(self) -> None:
        layers = self.spec.layers
        _check_arrays("weights", self.weights, [layer.weight_shape for layer in layers], np.int8)
        _check_arrays(
            "thresholds",
            self.thresholds,
            [(layer.out_channels,) for layer in layers[:-1]],
            np.int32,
        )
        for layer, signs in zip(layers, self.weights, strict=True):
            if not np.all(np.abs(signs) == 1):
                raise BlobError(f"weights of {layer.name} hold values other than -1 and +1")
        if not (np.isfinite(np.float32(self.scale)) and np.float32(self.scale) > 0):
            raise BlobError(f"scale (lambda) = {self.scale} must be a finite float32 above 0")
        check_provenance(self.attempt, self.version)

    @classmethod
    def random(cls, spec: NetworkSpec, rng: np.random.Generator) -> Self:
        """A blob with random signs, and thresholds spread over where each layer's sums lie."""
        weights = tuple(
            rng.choice(np.array([-1, 1], np.int8), size=layer.weight_shape) for layer in spec.layers
        )
        thresholds = tuple(
            np.rint(
                rng.normal(0, np.sqrt(layer.fan_in) * layer.max_input, layer.out_channels)
            ).astype(np.int32)
            for layer in spec.layers[:-1]
        )
        return cls(spec, weights, thresholds, scale=float(np.float32(rng.uniform(0.05, 0.5))))

    def parameters(self) -> Parameters:
        """Every weight and threshold by name, as what is read back from a kernel's memory is compared with.

        Of the thresholds that decide alike for every sum o that can occur, the one that stands for all.
        """
        layers = self.spec.layers
        weights = {
            f"weights of {layer.name}": signs
            for layer, signs in zip(layers, self.weights, strict=True)
        }
        thresholds = {
            f"thresholds of {layer.name}": canonical_thresholds(layer, tau)
            for layer, tau in zip(layers[:-1], self.thresholds, strict=True)
        }
        return weights | thresholds

    def content_sha256(self) -> str:
        """SHA-256 (hex) of what the policy computes: geometry, signs, thresholds, lambda.

        Run, attempt and version are left out: equal policies have equal digests whoever made them.
        """
        digest = hashlib.sha256(
            struct.pack(
                "<HHHf", self.spec.channels, self.spec.hidden_units, self.spec.actions, self.scale
            )
        )
        digest.update(self._body())
        return digest.hexdigest()

    def encode(self) -> bytes:
        """The blob as bytes, `encoded_size(spec)` of them."""
        header = Header(self.spec, self.run, self.attempt, self.version, self.scale)
        return _ENVELOPE.seal(header, self._body())

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Reads `encode`'s bytes.

        Raises:
            BlobError: truncated, oversized, altered, of another schema, or not a blob at all.
        """
        header = _ENVELOPE.header(data)
        body = _ENVELOPE.body(data, _body_bytes(header.spec))
        weights, thresholds = _split_body(header.spec, body)
        return cls(
            header.spec, weights, thresholds, header.own, header.run, header.attempt, header.version
        )

    def _body(self) -> bytes:
        bits = (np.packbits(signs > 0, bitorder="little").tobytes() for signs in self.weights)
        taus = (tau.astype("<i4").tobytes() for tau in self.thresholds)
        return b"".join((*bits, *taus))


def canonical_thresholds(layer: Layer, tau: Thresholds) -> Thresholds:
    """int32[out]: each the largest that decides as tau does for every sum that the layer can have.

    Sums of pixels are any integer in -max..max, sums of n signs are n, n-2, ... -n.
    """
    wide, most = tau.astype(np.int64), layer.max_output
    if layer.max_input == 1:
        wide = layer.fan_in - 2 * ((layer.fan_in - wide) // 2)
        return np.clip(wide, -most, most + 2).astype(np.int32)
    return np.clip(wide, -most, most + 1).astype(np.int32)


def encoded_size(spec: NetworkSpec) -> int:
    """Bytes of a blob with this geometry."""
    return _ENVELOPE.size(_body_bytes(spec))


def _body_bytes(spec: NetworkSpec) -> int:
    signs = sum(_packed_bytes(layer.out_channels * layer.fan_in) for layer in spec.layers)
    thresholds = sum(4 * layer.out_channels for layer in spec.layers[:-1])
    return signs + thresholds


def _packed_bytes(bits: int) -> int:
    return (bits + 7) // 8


def _split_body(spec: NetworkSpec, body: bytes) -> tuple[tuple[Signs, ...], tuple[Thresholds, ...]]:
    raw = np.frombuffer(body, np.uint8)
    weights: list[Signs] = []
    thresholds: list[Thresholds] = []
    offset = 0
    for layer in spec.layers:
        count = layer.out_channels * layer.fan_in
        bits = np.unpackbits(raw[offset : offset + _packed_bytes(count)], bitorder="little")
        if bits[count:].any():
            raise BlobError(f"padding bits of {layer.name} are not zero")
        weights.append((bits[:count].astype(np.int8) * 2 - 1).reshape(layer.weight_shape))
        offset += _packed_bytes(count)
    for layer in spec.layers[:-1]:
        thresholds.append(np.frombuffer(body, "<i4", layer.out_channels, offset).astype(np.int32))
        offset += 4 * layer.out_channels
    return tuple(weights), tuple(thresholds)


def _check_arrays(
    name: str,
    arrays: Sequence[npt.NDArray[np.generic]],
    shapes: Sequence[tuple[int, ...]],
    dtype: type[np.generic],
) -> None:
    found = [(str(array.dtype), array.shape) for array in arrays]
    expected = [(np.dtype(dtype).name, shape) for shape in shapes]
    if found != expected:
        raise BlobError(f"{name} are {found}, the geometry needs {expected}")
